"""Ways back for a robot that starts too near to something: floors that ratchet up.

A pair whose certified bound is below its limit has a floor, the best value it has reached. An increment
keeps the way back open if no violated pair is proven to fall below its floor by more than 0.2 mm in all, at
least one margin is proven to widen, and nothing new is violated. A retreat begins at rest, when no setpoint
of the past counts any more: the first floor is what was reached where the robot stands.

Two robots that violate a pair move one at a time, the first in the configuration first: as long as it is
asked to move, and could, the other is refused and brakes. It gives way by resting, or if it finds no way out.
"""

from dataclasses import dataclass

import numpy as np

from armgate.events import Joints
from armgate.gate.certificate import Budget
from armgate.gate.clearance import Clearance
from armgate.gate.question import Binding
from armgate.gate.robot import RobotState
from armgate.gate.swept import Array

PAIR_SLACK = 2e-4
"""How far a violated pair may fall below its floor, m."""

_PATIENCE = 3
"""So many ticks without being asked to move, and a robot no longer goes first."""

_WIDER = 1e-7
_PROOF_BUDGET = 32


@dataclass(frozen=True, slots=True)
class Demand:
    """What a robot's pairs must keep.

    Attributes:
        need: m, one a pair of the robot, (P,).
        violated: The violated pairs that it may move out of, and what is proven of them.
        forbidden: What forbids any motion.
    """

    need: Array
    violated: tuple[Binding, ...]
    forbidden: Binding | None


class Retreat:
    """The floors of all violated pairs, and whose turn it is."""

    def __init__(self, clearance: Clearance) -> None:
        self._clearance = clearance
        self._floor: dict[int, float] = {}
        self._claim: dict[int, int] = {}
        """The tick at which a robot was last asked to move and could, or only had to wait for another."""

    def demand(self, state: RobotState, states: list[RobotState]) -> Demand:
        """Proves a robot's violated pairs anew, ratchets their floors, says what motion must keep."""
        need, violated = self._clearance.limits_of[state.index], []
        waits, forbidden = False, None
        for pair in self._clearance.below(state.index):
            binding = self._clearance.prove_held(state.index, pair, Budget(_PROOF_BUDGET))
            if binding.lb >= binding.need:
                self._floor.pop(pair, None)
            elif not (pair in self._floor or (state.resting and state.arrived)):
                forbidden = binding
            elif not self._has_turn(state, states, pair):
                forbidden, waits = binding, True
            else:
                violated.append(binding)
                self._floor[pair] = max(self._floor.get(pair, -np.inf), binding.lb)
        if waits:
            self._claim[state.index] = state.tick
        if violated:
            need = need.copy()
            for v in violated:
                need[self._clearance.pairs_of[state.index] == v.pair] = self._floor[v.pair] - PAIR_SLACK
        return Demand(need, tuple(violated), forbidden)

    def claim(self, state: RobotState, admitted: bool) -> None:
        """Notes whether a robot that was judged found a way out: then it goes first, else it gives way."""
        if admitted:
            self._claim[state.index] = state.tick
        else:
            self._claim.pop(state.index, None)

    def forget(self, robot: int) -> None:
        """Forget the floors of a robot's pairs: what it had reached is not where it was found."""
        for pair in self._clearance.pairs_of[robot].tolist():
            self._floor.pop(pair, None)

    def widens(self, state: RobotState, end: Joints, violated: tuple[Binding, ...]) -> bool:
        """Says whether at least one violated margin, of a joint or of a pair, is proven wider at ``end``."""
        low, high = state.outside
        for q, x, below, above in zip(state.setpoint, end, low, high, strict=True):
            if (below and x > q) or (above and x < q):
                return True
        bound = self._clearance.point_bound
        return any(
            bound(state.index, v.pair, end) > bound(state.index, v.pair, state.setpoint) + _WIDER
            for v in violated
        )

    def _has_turn(self, state: RobotState, states: list[RobotState], pair: int) -> bool:
        """All others that the pair violates rest, and none of them goes first."""
        cell_pair, bodies = self._clearance.cell.pairs[pair], self._clearance.cell.bodies
        both = {bodies[cell_pair.a].robot, bodies[cell_pair.b].robot}
        others = [states[k] for k in both if k is not None and k != state.index]
        return all(s.resting and not (s.index < state.index and self._claims(s)) for s in others)

    def _claims(self, state: RobotState) -> bool:
        at = self._claim.get(state.index)
        held = state.fence is not None and not state.stops
        return held and at is not None and state.tick - at <= _PATIENCE
