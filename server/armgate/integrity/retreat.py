"""Ways back for a robot that starts too near to something: floors that ratchet up.

A pair whose certified bound is below its limit has a floor, the best value it has reached. An increment
keeps the way back open if no violated pair is proven to fall below its floor by more than 0.2 mm in all, at
least one margin is proven to widen, and nothing new is violated. A retreat begins at rest; two robots that
violate a pair move one at a time.
"""

from dataclasses import dataclass

import numpy as np

from armgate.cell.events import Joints
from armgate.integrity.certificate import Budget
from armgate.integrity.clearance import Binding, Clearance
from armgate.integrity.robot import RobotState
from armgate.integrity.swept import Array

PAIR_SLACK = 2e-4
"""How far a violated pair may fall below its floor, m."""

_WIDER = 1e-7
_PROOF_BUDGET = 32


@dataclass(frozen=True, slots=True)
class Demand:
    """What a robot's pairs must keep, m (pairs of the cell,), which are violated, what forbids any motion."""

    need: Array
    violated: tuple[int, ...]
    forbidden: Binding | None


class Retreat:
    """The floors of all violated pairs."""

    def __init__(self, clearance: Clearance) -> None:
        self._clearance = clearance
        self._floor: dict[int, float] = {}

    def demand(self, state: RobotState, states: list[RobotState]) -> Demand:
        """Proves a robot's violated pairs anew, ratchets their floors, says what motion must keep."""
        need = self._clearance.limits
        violated, forbidden = [], None
        for pair in self._below(state.index):
            binding = self._clearance.prove_held(state.index, pair, Budget(_PROOF_BUDGET))
            if binding.lb >= binding.need:
                self._floor.pop(pair, None)
                continue
            if self._may_move(state, states, pair):
                violated.append(pair)
                self._floor[pair] = max(self._floor.get(pair, -np.inf), binding.lb)
            else:
                forbidden = binding
        if violated:
            need = need.copy()
            need[violated] = [self._floor[p] - PAIR_SLACK for p in violated]
        return Demand(need, tuple(violated), forbidden)

    def widens(self, state: RobotState, end: Joints, violated: tuple[int, ...]) -> bool:
        """Says whether at least one violated margin, of a joint or of a pair, is proven wider at ``end``."""
        low, high = state.outside
        for q, x, below, above in zip(state.setpoint, end, low, high, strict=True):
            if (below and x > q) or (above and x < q):
                return True
        bound = self._clearance.point_bound
        return any(
            bound(state.index, p, end) > bound(state.index, p, state.setpoint) + _WIDER for p in violated
        )

    def _below(self, robot: int) -> list[int]:
        ids = self._clearance.pairs_of[robot]
        return [int(p) for p in ids[self._clearance.bound[ids] < self._clearance.limits[ids]]]

    def _may_move(self, state: RobotState, states: list[RobotState], pair: int) -> bool:
        begun = pair in self._floor
        cell_pair, bodies = self._clearance.cell.pairs[pair], self._clearance.cell.bodies
        others = {bodies[cell_pair.a].robot, bodies[cell_pair.b].robot} - {state.index, None}
        return (begun or state.resting) and all(states[k].resting for k in others if k is not None)
