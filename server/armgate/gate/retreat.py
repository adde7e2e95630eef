"""Retreat of a robot that starts too near to something: floors that only rise.

A pair whose certified bound is below its limit has a floor, the best value that it has reached. An increment
is a retreat if every violated pair is proven to fall at most 0.2 mm below its floor in total, at least one
margin is proven to widen, and nothing new is violated. A retreat begins at rest, when only the setpoint in
force counts: the first floor is the value at the place where the robot stands.

Two robots that violate the same pair move one at a time, in the order of the configuration. While the first
robot is commanded to move and can move, commands for the second are refused, and it brakes. The first robot
loses its turn when it is no longer commanded to move, or if no way out is found for it.
"""

from typing import NamedTuple

import numpy as np

from armgate.events import Joints
from armgate.gate.clearance import Clearance
from armgate.gate.clearance.certificate import Budget
from armgate.gate.clearance.pair_check import Binding
from armgate.gate.clearance.swept import Array
from armgate.gate.robot import RobotState

PAIR_SLACK = 2e-4
"""Largest distance that a violated pair may fall below its floor, m."""

_TURN_TICKS = 3
"""Number of ticks without a command to move after which a robot loses its turn."""

_WIDER = 1e-7
_PROOF_BUDGET = 32


class Requirements(NamedTuple):
    """Distances that a robot's pairs must keep.

    Attributes:
        need: Distance to keep of each of the robot's P pairs, m, (P,).
        violated: The violated pairs that it may move out of, with their proven bounds.
        forbidden: The pair that forbids any motion; None if there is none.
    """

    need: Array
    violated: tuple[Binding, ...]
    forbidden: Binding | None


class Retreat:
    """Floors of all violated pairs, and the order in which robots leave a pair that both violate."""

    def __init__(self, clearance: Clearance) -> None:
        self._clearance = clearance
        self._floor: dict[int, float] = {}
        self._turn: dict[int, int] = {}
        """Tick at which a robot last found a way out, or was refused only because of another robot's turn."""

    def requirements(self, state: RobotState, states: list[RobotState]) -> Requirements:
        """Prove a robot's violated pairs anew, raise their floors, and return the distances to keep."""
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
            self._turn[state.index] = state.tick
        if violated:
            need = need.copy()
            for v in violated:
                need[self._clearance.pairs_of[state.index] == v.pair] = self._floor[v.pair] - PAIR_SLACK
        return Requirements(need, tuple(violated), forbidden)

    def note_result(self, state: RobotState, admitted: bool) -> None:
        """Update a robot's turn after a decision: keep it if a way out was found, end it otherwise."""
        if admitted:
            self._turn[state.index] = state.tick
        else:
            self._turn.pop(state.index, None)

    def forget(self, robot: int) -> None:
        """Forget the floors of a robot's pairs: they were reached at another position."""
        for pair in self._clearance.pairs_of[robot].tolist():
            self._floor.pop(pair, None)

    def widens(self, state: RobotState, end: Joints, violated: tuple[Binding, ...]) -> bool:
        """Return True if at least one violated margin, of a joint or a pair, is proven wider at ``end``."""
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
        """Return True if the other robot of the pair rests and does not hold an earlier turn."""
        cell_pair, bodies = self._clearance.cell.pairs[pair], self._clearance.cell.bodies
        both = {bodies[cell_pair.a].robot, bodies[cell_pair.b].robot}
        others = [states[k] for k in both if k is not None and k != state.index]
        return all(s.resting and not (s.index < state.index and self._keeps_turn(s)) for s in others)

    def _keeps_turn(self, state: RobotState) -> bool:
        at = self._turn.get(state.index)
        commanded = state.fence is not None and not state.stops
        return commanded and at is not None and state.tick - at <= _TURN_TICKS
