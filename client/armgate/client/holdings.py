"""What this client holds, lost and why, and the stops that it was told of."""

from armgate.client.errors import LeaseLost, Lost, RobotStopped
from armgate.protocol.messages import Lease, Resumed, Stopped


class Holdings:
    """Leases by robot and fence.

    Attributes:
        stops: The stops in force, by id.
    """

    def __init__(self) -> None:
        self.stops: dict[int, Stopped] = {}
        self._held: dict[str, Lease] = {}
        self._lost: dict[tuple[str, int], Lost] = {}

    @property
    def ttl(self) -> float | None:
        """The shortest time to live of what is held, s; None where nothing is."""
        return min((lease.ttl for lease in self._held.values()), default=None)

    def holds(self, robot: str, fence: int) -> bool:
        """Whether this lease is in force, as far as is known here."""
        lease = self._held.get(robot)
        return lease is not None and lease.fence == fence and (robot, fence) not in self._lost

    def check(self, robot: str, fence: int) -> None:
        """Raises why this lease is not in force, if it is not.

        Raises:
            Lost: ``RobotStopped`` or ``LeaseLost``.
        """
        if (lost := self._lost.get((robot, fence))) is not None:
            raise lost
        if not self.holds(robot, fence):
            raise LeaseLost(robot, "it was given back, or acquired anew by this client")

    def take_lease(self, lease: Lease) -> None:
        """A lease was given, given back, or lost."""
        if lease.state == "held":
            self._held[lease.robot] = lease
            return
        held = self._held.get(lease.robot)
        if held is not None and held.fence == lease.fence:
            del self._held[lease.robot]
        if lease.state == "lost":
            # Where a stop was the cause it was told before, and tells more.
            reason = lease.reason or "no reason given"
            self._lost.setdefault((lease.robot, lease.fence), LeaseLost(lease.robot, reason))

    def take_stopped(self, stopped: Stopped) -> None:
        """A stop is in force: what it names is held no longer."""
        if stopped.replaces is not None:
            self.stops.pop(stopped.replaces, None)
        self.stops[stopped.stop] = stopped
        for robot in stopped.robots:
            if (held := self._held.get(robot)) is not None:
                self._lost.setdefault((robot, held.fence), RobotStopped(robot, stopped))

    def take_resumed(self, resumed: Resumed) -> None:
        """A stop was lifted; what it took must be acquired again."""
        self.stops.pop(resumed.stop, None)
        if resumed.lifted is not None:
            self.stops.pop(resumed.lifted, None)
