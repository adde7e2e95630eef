"""Judges one wish: what the robot's own bounds leave of it, then clearance; one way to reduce, everywhere.

u = u_b + β(u_wanted − u_b). ``stop``: clearance takes the β that the bounds left, or 0. ``slow``: the
largest of a few β that is proven, found by the secant of the binding pair's margin; all trials share one
budget.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from armgate.events import Cause, Joints, Point, Reason
from armgate.gate.braking import stop_increments
from armgate.gate.certificate import Budget
from armgate.gate.clearance import Clearance
from armgate.gate.limits import Wish, blend, shape_wish, stays_inside
from armgate.gate.occupancy import Occupancy
from armgate.gate.question import Binding
from armgate.gate.retreat import Demand, Retreat
from armgate.gate.robot import RobotState, end_of
from armgate.gate.swept import Array, Swept

BUDGET = 32
"""Engine evaluations that one command may cost."""

_JOINTS = -1
"""In the place of a pair: a joint outside of its limits binds."""

_TRIALS = 2
_SECANT = 0.98
_GRID = 2.0**-20
"""Step of a blend that clearance gives: far above rounding, far below what a robot can show."""

_DIGITS = 9
"""Decimals of lengths in reasons, m: a nanometre."""


@dataclass(frozen=True, slots=True)
class Decision:
    """The increments to play, β, what bound them; the occupancy and bounds proven, None if u_b is kept."""

    increments: tuple[Joints, ...]
    beta: float
    reasons: tuple[Reason, ...]
    occupied: Occupancy | None = None
    swept: Swept | None = None
    lb: Array | None = None


class Judge:
    """Decides about wishes; keeps nothing but the floors and turns of retreats."""

    def __init__(self, clearance: Clearance, response: str) -> None:
        self._clearance = clearance
        self._retreat = Retreat(clearance)
        self._slow = response == "slow"

    def decide(self, dq: Joints, state: RobotState, states: list[RobotState]) -> Decision:
        """Decides about the wish ``dq`` of a command that may be judged."""
        bounds = state.limits_now()
        wish = shape_wish(dq, state.last, state.brake, state.setpoint, bounds, state.share)
        if wish.u == state.brake:
            return Decision(self._braking(state), wish.beta, wish.reasons)
        demand = self._retreat.demand(state, states)
        if demand.forbidden is not None:
            return self._refuse(state, wish, demand.forbidden)
        decision = self._clear(wish, state, demand)
        if demand.violated:
            self._retreat.claim(state, decision.beta > 0.0)
        return decision

    def forget(self, robot: int) -> None:
        """Forget what a robot's retreat had reached: it was found elsewhere."""
        self._retreat.forget(robot)

    def _clear(self, wish: Wish, state: RobotState, demand: Demand) -> Decision:
        """Tries the wish; in ``slow`` mode also less of it."""
        budget = Budget(BUDGET)
        beta, binding = 1.0, None
        for _ in range(self._trials(state, demand)):
            u = blend(state.brake, wish.u, beta)
            if beta < 1.0 and stays_inside(u, state.setpoint, state.limits_now()) is not None:
                break
            decided = self._try(u, wish, beta, state, demand, budget)
            if isinstance(decided, Decision):
                if binding is None:
                    return decided
                return replace(decided, reasons=(*decided.reasons, self._reason(binding, state)))
            binding = decided
            if binding.pair == _JOINTS:
                break  # less of a motion that does not lead back inside does not either
            beta = self._secant(beta, binding)
        assert binding is not None
        return self._refuse(state, wish, binding)

    def _trials(self, state: RobotState, demand: Demand) -> int:
        """Return how many blends are tried.

        The faster axes that lag differently move, the farther they may stray, also from the way out.
        """
        blends = state.stray is not None if demand.violated else self._slow
        return _TRIALS + 1 if blends else 1

    def _try(
        self, u: Joints, wish: Wish, beta: float, state: RobotState, demand: Demand, budget: Budget
    ) -> Decision | Binding:
        increments = stop_increments(u, state.bounds.decel) or (state.zeros,)
        end = end_of(state.setpoint, increments)
        occupied = state.occupancy_to(end, increments[0])
        swept = self._clearance.space.sweep(state.index, occupied)
        judged = self._clearance.judge(state.index, swept, self._step(state, occupied), demand.need, budget)
        if judged.binding is not None:
            return judged.binding
        if (demand.violated or any(map(any, state.outside))) and not self._retreat.widens(
            state, end, demand.violated
        ):
            return demand.violated[0] if demand.violated else Binding(_JOINTS, 0.0, 0.0, None)
        total = wish.beta * beta
        return Decision(increments, total, wish.reasons, occupied, swept, judged.lb)

    def _secant(self, beta: float, binding: Binding) -> float:
        """Return where the binding pair's margin, linear from the held path to the wish, would be used up.

        Down to a grid: the compiled kernels and numpy round differently, and must not decide differently.
        """
        held = self._clearance.bound[binding.pair] - binding.need
        tried = binding.lb - binding.need
        if not (np.isfinite(tried) and held > 0.0):
            return 0.5 * beta
        return math.floor(_SECANT * beta * held / (held - tried) / _GRID) * _GRID

    def _step(self, state: RobotState, new: Occupancy) -> Array | None:
        """By how much an occupancy extends the held one, per joint; None if that cannot be said."""
        held = state.reserved
        if len(held) != 1:
            return None
        step = np.abs(np.subtract(new.end, held[0].occupied.end))
        if new.unlike:
            step += np.maximum(np.subtract(new.unlike, held[0].occupied.unlike), 0.0)
        return np.asarray(step)

    def _braking(self, state: RobotState) -> tuple[Joints, ...]:
        return state.remaining or (state.zeros,)

    def _refuse(self, state: RobotState, wish: Wish, binding: Binding) -> Decision:
        return Decision(self._braking(state), 0.0, (*wish.reasons, self._reason(binding, state)))

    def _reason(self, binding: Binding, state: RobotState) -> Reason:
        if binding.pair == _JOINTS:
            return _outside(state)
        a, b = self._clearance.names(binding.pair)
        limit = float(self._clearance.limits[binding.pair])
        proven = f"{round(1e3 * binding.lb, 1) + 0.0:.1f} mm" if np.isfinite(binding.lb) else "no distance"
        text = f"{a} and {b}: {proven} could be proven on the way to rest, {1e3 * limit:.1f} mm must be kept"
        value = math.floor(binding.lb * 10**_DIGITS) / 10**_DIGITS if np.isfinite(binding.lb) else None
        points = _rounded(self._witness(binding, state))
        return Reason(Cause.CLEARANCE, text, pair=(a, b), value=value, bound=limit, points=points)

    def _witness(self, binding: Binding, state: RobotState) -> tuple[Point, Point] | None:
        """The points of the engine's last answer; where the budget ended before it was asked, of one more."""
        return binding.points or self._clearance.prove_held(state.index, binding.pair, Budget(1)).points


def _rounded(points: tuple[Point, Point] | None) -> tuple[Point, Point] | None:
    if points is None:
        return None
    (a, b, c), (d, e, f) = points
    return (_length(a), _length(b), _length(c)), (_length(d), _length(e), _length(f))


def _length(x: float) -> float:
    return round(x, _DIGITS) + 0.0  # no minus zero


def _outside(state: RobotState) -> Reason:
    """The first joint that is outside of its limits, and cannot go on but back."""
    b, (low, high) = state.bounds, state.outside
    j = next(j for j, both in enumerate(zip(low, high, strict=True)) if any(both))
    limit = b.lower[j] if low[j] else b.upper[j]
    text = f"{b.names[j]} is outside its limit {b.amount(j, limit)}: only motion back inside is allowed"
    return Reason(Cause.JOINT_LIMIT, text, joint=b.names[j], value=state.setpoint[j], bound=limit)
