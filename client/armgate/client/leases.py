"""Leases that this client holds or has lost, and the stops that it was notified of."""

from armgate.client.errors import LeaseLost, Lost, RobotStopped
from armgate.protocol.messages import Lease, Resumed, Stopped


class HeldLeases:
    """Leases of this client by robot and fence.

    Attributes:
        stops: The stops in force, by id.
    """

    def __init__(self) -> None:
        self.stops: dict[int, Stopped] = {}
        self._held: dict[str, Lease] = {}
        self._lost: dict[tuple[str, int], Lost] = {}

    @property
    def ttl(self) -> float | None:
        """Shortest time to live of the held leases, s; None if no robot is held."""
        return min((lease.ttl for lease in self._held.values()), default=None)

    def holds(self, robot: str, fence: int) -> bool:
        """Return True if this lease is in force, as far as this client was notified."""
        lease = self._held.get(robot)
        return lease is not None and lease.fence == fence and (robot, fence) not in self._lost

    def check(self, robot: str, fence: int) -> None:
        """Check that this lease is in force.

        Raises:
            Lost: It is not; ``RobotStopped`` or ``LeaseLost`` with the reason.
        """
        if (lost := self._lost.get((robot, fence))) is not None:
            raise lost
        if not self.holds(robot, fence):
            raise LeaseLost(robot, "this client released the robot or acquired it again")

    def take_lease(self, lease: Lease) -> None:
        """Record a lease that was granted, released, or lost."""
        if lease.state == "held":
            self._held[lease.robot] = lease
            return
        held = self._held.get(lease.robot)
        if held is not None and held.fence == lease.fence:
            del self._held[lease.robot]
        if lease.state == "lost":
            # If a stop ended the lease, `take_stopped` has recorded that reason already, with more detail.
            reason = lease.reason or "no reason given"
            self._lost.setdefault((lease.robot, lease.fence), LeaseLost(lease.robot, reason))

    def take_stopped(self, stopped: Stopped) -> None:
        """Record a stop that is in force: the leases of its robots ended."""
        if stopped.replaces is not None:
            self.stops.pop(stopped.replaces, None)
        self.stops[stopped.stop] = stopped
        for robot in stopped.robots:
            if (held := self._held.get(robot)) is not None:
                self._lost.setdefault((robot, held.fence), RobotStopped(robot, stopped))

    def take_resumed(self, resumed: Resumed) -> None:
        """Record a stop that was lifted; its robots must be acquired again."""
        self.stops.pop(resumed.stop, None)
        if resumed.lifted is not None:
            self.stops.pop(resumed.lifted, None)
