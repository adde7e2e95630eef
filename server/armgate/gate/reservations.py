"""Reserved occupancies of each robot: along the plan that its link holds, and along one not yet answered.

A plan is replaced by compare-and-swap at the link. Until its answer the gate reserves both occupancies, the
old and the new, and every kept bound is the lower of both.
"""

import numpy as np

from armgate.events import Joints, Plan
from armgate.gate.clearance import Clearance
from armgate.gate.clearance.certificate import Budget
from armgate.gate.clearance.swept import Array
from armgate.gate.decision import Decision
from armgate.gate.occupancy import occupancy_at, occupancy_to
from armgate.gate.robot import Reserved, RobotState

_BUDGET = 64
"""Engine evaluations that a reset may cost for each robot whose setpoint it moves."""


class Reservations:
    """Reserved occupancies of all robots, kept consistent with the bounds that are proven for them."""

    def __init__(self, clearance: Clearance) -> None:
        self._clearance = clearance
        # Bounds proven for pairs of robots whose links have not answered their plans yet.
        self._staged: dict[int, Array] = {}

    def reserve_held_plan(self, s: RobotState) -> None:
        """Reserve the occupancy along the held plan, and only that."""
        if self._clearance.space.ranges[s.index].levers:
            self._clearance.fit(s.index, s.reachable_points, s.reachable_margin)
        occupied = occupancy_to(s, s.end, s.brake)
        s.main, s.next = Reserved(occupied, self._clearance.sweep(s.index, occupied)), None
        self._hold(s)

    def stage(self, s: RobotState, plan: Plan, decision: Decision) -> None:
        """Reserve a new plan's occupancy beside the old one until the link has answered."""
        s.pending = plan
        if decision.occupied is None or decision.swept is None or decision.lb is None:
            return  # the plan is the remainder of the held one, which is already reserved
        self._lower_staged(s.index, decision.lb)
        self._staged[s.index] = decision.lb
        self._clearance.bound.lower(s.index, decision.lb)
        s.next = Reserved(decision.occupied, decision.swept)
        self._hold(s)

    def accept_pending(self, s: RobotState) -> None:
        """Replace the held plan by the pending one, which the link has accepted; free the old occupancy."""
        s.held, s.played, s.pending = s.pending, -1, None
        s.main, s.next = s.next or s.main, None
        self._hold(s)
        staged = self._staged.pop(s.index, None)
        if staged is not None:
            self._clearance.bound.put(s.index, staged)

    def drop_pending(self, s: RobotState) -> None:
        """Drop the pending plan, which the link has not accepted.

        The bounds stay at the lower of both, which holds for the old plan too.
        """
        s.pending, s.next = None, None
        self._staged.pop(s.index, None)
        self._hold(s)

    def prove_anew(self, s: RobotState) -> None:
        """Prove a robot's pairs anew after the kept bounds became void; also for plans not yet answered."""
        self._clearance.prove_all(s.index)
        self._lower_staged(s.index, self._clearance.bound.of(s.index))

    def prove_setpoint(self, s: RobotState, setpoint: Joints) -> bool:
        """Prove that a robot at rest may take another setpoint, and keep the bounds; return False if not.

        Every pair must keep its limit, or its kept bound if that is less.
        """
        c = self._clearance
        swept = c.sweep(s.index, occupancy_at(s, setpoint))
        need = np.minimum(c.limits_of[s.index], c.bound.of(s.index))
        result = c.check(s.index, swept, None, need, Budget(_BUDGET))
        if result.binding is not None:
            return False
        c.bound.put(s.index, result.lb)
        self._lower_staged(s.index, result.lb)
        return True

    def _lower_staged(self, robot: int, lb: Array) -> None:
        """Lower staged bounds to ``lb``, pair by pair: they must hold for everything that is reserved."""
        if not self._staged:
            return
        own = self._staged.get(robot)
        if own is not None:
            np.minimum(own, lb, out=own)
        for other, here, there in self._clearance.bound.shared(robot):
            staged = self._staged.get(other)
            if staged is not None:
                staged[there] = np.minimum(staged[there], lb[here])

    def _hold(self, s: RobotState) -> None:
        self._clearance.hold(s.index, [r.swept for r in s.reserved])
