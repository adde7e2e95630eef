"""What is reserved for each robot: along the plan that its link holds, and along one not yet answered.

A plan is replaced by compare-and-swap at the link. Until its answer the gate reserves both occupancies, the
old and the new, and every kept bound is the lower of both.
"""

import numpy as np

from armgate.cell.events import Plan
from armgate.integrity.clearance import Clearance
from armgate.integrity.judge import Decision
from armgate.integrity.robot import Reserved, RobotState
from armgate.integrity.swept import Array


class Reservations:
    """Keeps the robots' reserved occupancies and what is proven of them in step."""

    def __init__(self, clearance: Clearance) -> None:
        self._clearance = clearance
        # Bounds proven for plans that their links have not answered yet, all pairs of the cell, by robot.
        self._staged: dict[int, Array] = {}

    def hold_plan(self, s: RobotState) -> None:
        """Reserves what the robot may still pass along the held plan."""
        occupied = s.occupancy_to(s.end)
        s.main, s.next = Reserved(occupied, self._clearance.space.sweep(s.index, occupied)), None
        self._hold(s)

    def stage(self, s: RobotState, plan: Plan, decision: Decision) -> None:
        """Reserves a new plan's occupancy beside the old one, until the link has answered."""
        s.pending = plan
        if decision.occupied is None or decision.swept is None or decision.lb is None:
            return  # the plan is the rest of the held one: reserved already
        ids, bound = self._clearance.pairs_of[s.index], self._clearance.bound
        for staged in self._staged.values():
            staged[ids] = np.minimum(staged[ids], decision.lb[ids])
        self._staged[s.index] = decision.lb
        np.minimum(bound, decision.lb, out=bound)  # of the pairs of others, both are the same
        s.next = Reserved(decision.occupied, decision.swept)
        self._hold(s)

    def take_over(self, s: RobotState) -> None:
        """The link has the new plan: the old occupancy is free again."""
        s.held, s.played, s.pending = s.pending, -1, None
        s.main, s.next = s.next or s.main, None
        self._hold(s)
        staged = self._staged.pop(s.index, None)
        if staged is not None and not s.residue:
            ids = self._clearance.pairs_of[s.index]
            self._clearance.bound[ids] = staged[ids]

    def drop(self, s: RobotState) -> None:
        """The link keeps the old plan; the bounds stay at the lower of both, which holds for it too."""
        s.pending, s.next = None, None
        self._staged.pop(s.index, None)
        self._hold(s)

    def renew(self, s: RobotState) -> None:
        """Proves a robot's pairs anew where what was proven is void; also for what waits for an answer."""
        self._clearance.survey(s.index)
        ids, bound = self._clearance.pairs_of[s.index], self._clearance.bound
        for staged in self._staged.values():
            staged[ids] = np.minimum(staged[ids], bound[ids])

    def _hold(self, s: RobotState) -> None:
        self._clearance.hold(s.index, [r.swept for r in s.reserved])
