"""Decision about one command: joint limits, then retreat, then clearance.

All three reduce an increment in the same way:

u = u_b + β(u_wanted − u_b), where u_b is the next braking increment of the held plan. With the response
``stop``, clearance admits the β that the joint limits left, or 0. With ``slow`` it admits the largest of a
few trial values of β that it can prove. They are found by the secant of the binding pair's margin; all trials
share one budget.
"""

import math
from typing import Literal, NamedTuple, assert_never

import numpy as np

from armgate.events import Joints, Point, Reason
from armgate.gate import verdict_wording
from armgate.gate.braking import end_of, stop_increments
from armgate.gate.clearance import Clearance
from armgate.gate.clearance.certificate import Budget
from armgate.gate.clearance.pair_check import Binding
from armgate.gate.clearance.swept import Array, Swept
from armgate.gate.joint_limits import LimitedIncrement, blend, first_outside, limit_increment
from armgate.gate.occupancy import Occupancy, occupancy_to
from armgate.gate.retreat import Requirements, Retreat
from armgate.gate.robot import RobotState

Response = Literal["stop", "slow"]

BUDGET = 32
"""Engine evaluations that one command may cost."""

_OUTSIDE_LIMITS = Binding(-1, 0.0, 0.0, None)
"""Placeholder for a joint outside its limits, which binds instead of a pair."""

_TRIALS = 2
_SECANT = 0.98
_GRID = 2.0**-20
"""Step of β by clearance: far above rounding, far below the resolution of a robot."""


class Decision(NamedTuple):
    """Increments to play, β, and reasons; occupancy and bounds that were proven, None if u_b is kept."""

    increments: tuple[Joints, ...]
    beta: float
    reasons: tuple[Reason, ...]
    occupied: Occupancy | None = None
    swept: Swept | None = None
    lb: Array | None = None


class DecisionMaker:
    """Decision maker of one cell; its only state is the floors and turns of retreats."""

    def __init__(self, clearance: Clearance, response: Response) -> None:
        self._clearance = clearance
        self._retreat = Retreat(clearance)
        match response:
            case "stop":
                self._slow = False
            case "slow":
                self._slow = True
            case _:
                assert_never(response)

    def decide(self, dq: Joints, state: RobotState, states: list[RobotState]) -> Decision:
        """Decide about the increment ``dq`` of a command that passed the checks."""
        bounds = state.limits_now()
        wanted = limit_increment(dq, state.last, state.brake, state.setpoint, bounds, state.share)
        if wanted.u == state.brake:
            return Decision(self._braking(state), wanted.beta, wanted.reasons)
        required = self._retreat.requirements(state, states)
        if required.forbidden is not None:
            return self._refuse(state, wanted, required.forbidden)
        decision = self._largest_clear(wanted, state, required)
        if required.violated:
            self._retreat.note_result(state, decision.beta > 0.0)
        return decision

    def forget(self, robot: int) -> None:
        """Forget the floors of a robot's retreat: they were reached at another position."""
        self._retreat.forget(robot)

    def _largest_clear(self, wanted: LimitedIncrement, state: RobotState, required: Requirements) -> Decision:
        """Try the wanted increment; if it is not clear and blends are allowed, try smaller ones."""
        budget = Budget(BUDGET)
        beta, binding = 1.0, None
        for _ in range(self._trials(state, required)):
            u = blend(state.brake, wanted.u, beta)
            if beta < 1.0 and first_outside(u, state.setpoint, state.limits_now()) is not None:
                break
            tried = self._try(u, wanted, beta, state, required, budget)
            if isinstance(tried, Decision):
                if binding is None:
                    return tried
                return tried._replace(reasons=(*tried.reasons, self._reason(binding, state)))
            binding = tried
            if binding is _OUTSIDE_LIMITS:
                break  # if a motion does not lead back inside, a smaller one does not either
            beta = self._secant(beta, binding)
        assert binding is not None
        return self._refuse(state, wanted, binding)

    def _trials(self, state: RobotState, required: Requirements) -> int:
        """Return the number of blends to try.

        In a retreat, a smaller motion helps only if axes lag differently: then the deviation from the way out
        grows with the speed.
        """
        blends = state.hull_deviation is not None if required.violated else self._slow
        return _TRIALS + 1 if blends else 1

    def _try(
        self,
        u: Joints,
        wanted: LimitedIncrement,
        beta: float,
        state: RobotState,
        required: Requirements,
        budget: Budget,
    ) -> Decision | Binding:
        """Return the decision for ``u`` if its stop is clear, else the binding pair or joint."""
        increments = stop_increments(u, state.bounds.decel) or (state.zeros,)
        occupied = occupancy_to(state, end_of(state.setpoint, increments), increments[0])
        swept = self._clearance.sweep(state.index, occupied)
        step = self._extension(state, occupied)
        result = self._clearance.check(state.index, swept, step, required.need, budget)
        if result.binding is not None:
            return result.binding
        if (required.violated or any(map(any, state.outside))) and not self._retreat.widens(
            state, occupied.end, required.violated
        ):
            return required.violated[0] if required.violated else _OUTSIDE_LIMITS
        return Decision(increments, wanted.beta * beta, wanted.reasons, occupied, swept, result.lb)

    def _secant(self, beta: float, binding: Binding) -> float:
        """Return the β at which the binding pair's margin, if it is linear in β, is nearly zero.

        It is rounded down to a grid: the compiled kernels and numpy round differently and must decide alike.
        """
        held = self._clearance.bound[binding.pair] - binding.need
        tried = binding.lb - binding.need
        if not (np.isfinite(tried) and held > 0.0):
            return 0.5 * beta
        return math.floor(_SECANT * beta * held / (held - tried) / _GRID) * _GRID

    def _extension(self, state: RobotState, new: Occupancy) -> Array | None:
        """Return the distance by which an occupancy extends the held one, per joint; None if unknown."""
        held = state.reserved
        if len(held) != 1:
            return None
        step = [abs(a - b) for a, b in zip(new.end, held[0].occupied.end, strict=True)]
        if new.lag_tube:
            growth = zip(step, new.lag_tube, held[0].occupied.lag_tube, strict=True)
            step = [a + max(b - c, 0.0) for a, b, c in growth]
        return np.array(step)

    def _braking(self, state: RobotState) -> tuple[Joints, ...]:
        return state.remaining or (state.zeros,)

    def _refuse(self, state: RobotState, wanted: LimitedIncrement, binding: Binding) -> Decision:
        return Decision(self._braking(state), 0.0, (*wanted.reasons, self._reason(binding, state)))

    def _reason(self, binding: Binding, state: RobotState) -> Reason:
        if binding is _OUTSIDE_LIMITS:
            return _outside(state)
        names, limit = self._clearance.names(binding.pair), float(self._clearance.limits[binding.pair])
        return verdict_wording.too_near(names, binding.lb, limit, self._witness_points(binding, state))

    def _witness_points(self, binding: Binding, state: RobotState) -> tuple[Point, Point] | None:
        """Return the points of the last engine query; query once if the budget ended before any query."""
        return binding.points or self._clearance.prove_held(state.index, binding.pair, Budget(1)).points


def _outside(state: RobotState) -> Reason:
    """Return the reason for the first joint that is outside its limits."""
    b, (low, high) = state.bounds, state.outside
    j = next(j for j, both in enumerate(zip(low, high, strict=True)) if any(both))
    return verdict_wording.outside_limit(b, j, state.setpoint[j], b.lower[j] if low[j] else b.upper[j])
