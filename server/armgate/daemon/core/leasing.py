"""Leases in force: told to the gate and to those who lose one."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

from armgate.daemon.core.peer import Peer, answer
from armgate.events import LeaseChange
from armgate.protocol import Denial, ErrorCode, Leases, Loss, RemoteProtocolError
from armgate.protocol import messages as m


@dataclass(frozen=True, slots=True)
class LeaseTime:
    """Time for leases.

    Attributes:
        now: Daemon time, s: leases are renewed from here.
        heard: Everything that clients had sent by then has been read: leases end by this.
    """

    now: float
    heard: float


NOBODY = -1
"""A fence that no lease has: a command with it is refused."""


class Leasing:
    """Who may command which robot.

    Args:
        leases: The lease machine.
        peers: The sessions by id.
        change: Tells the gate of a change.
        stops: Returns the stops in force for a robot.
    """

    def __init__(
        self,
        leases: Leases,
        peers: Mapping[str, Peer],
        change: Callable[[LeaseChange], None],
        stops: Callable[[str], Sequence[int]],
    ) -> None:
        self._leases = leases
        self._peers = peers
        self._change = change
        self._stops = stops

    def holder(self, robot: str) -> str | None:
        """Name of the holder, None if the robot is free."""
        grant = self._leases.holder(robot)
        return None if grant is None else self._peers[grant.session].name

    def held_by(self, session: str) -> set[str]:
        """The robots that a session holds."""
        return {grant.robot for grant in self._leases.held_by(session)}

    def holds(self, session: str) -> bool:
        """Return True if the session holds a robot."""
        return session in self._leases.sessions

    @property
    def sessions(self) -> set[str]:
        """The sessions that hold a robot."""
        return self._leases.sessions

    def acquire(self, peer: Peer, request: m.Acquire, time: LeaseTime) -> None:
        """Give the lease and answer, or raise the error to answer."""
        granted = self._leases.acquire(
            request.robot,
            peer.id,
            peer.role,
            takeover=request.takeover,
            speed=request.speed,
            now=time.now,
            heard=time.heard,
        )
        if isinstance(granted, Denial):
            raise RemoteProtocolError(granted.code, self._denied(request.robot, granted), about="acquire")
        if granted.displaced is not None:
            self._tell(granted.displaced)
        self._change(LeaseChange(granted.robot, granted.fence, granted.speed))
        peer.say(self._lease(request, granted.robot, granted.fence, "held", speed=granted.speed))

    def release(self, peer: Peer, request: m.Release, time: LeaseTime) -> None:
        """Take the lease back and answer, or raise the error to answer."""
        ended = self._leases.release(request.robot, peer.id, request.fence, time.heard)
        if isinstance(ended, Denial):
            raise RemoteProtocolError(ended.code, ended.text, about="release")
        self._change(LeaseChange(request.robot, None))
        peer.say(self._lease(request, request.robot, request.fence, "released"))

    def fence(self, peer: Peer, command: m.Command, time: LeaseTime) -> int:
        """The fence to judge a command by: the one that it names, but only from the robot's holder.

        A guessed number gives nobody a robot.
        """
        self.expire(time)
        return command.fence if command.robot in self.held_by(peer.id) else NOBODY

    def renew(self, peer: Peer, time: LeaseTime) -> None:
        """The session gave a sign of life."""
        self._leases.renew(peer.id, time.now, time.heard)

    def expire(self, time: LeaseTime) -> None:
        """End the leases whose holders were silent for too long."""
        self._lost(self._leases.expire(time.heard))

    def leave(self, peer: Peer) -> None:
        """The session is gone: its robots are free."""
        self._lost(self._leases.drop(peer.id))

    def stop(self, robots: Iterable[str], reason: str) -> None:
        """The robots were stopped: nobody holds them until ``resume``."""
        self._lost(self._leases.stop(robots, reason))

    def resume(self, robots: Iterable[str]) -> None:
        """The robots are free again."""
        self._leases.resume(robots)

    def _lost(self, losses: Iterable[Loss]) -> None:
        for loss in losses:
            self._change(LeaseChange(loss.robot, None))
            self._tell(loss)

    def _tell(self, loss: Loss) -> None:
        if (peer := self._peers.get(loss.session)) is not None:
            peer.say(self._lease(None, loss.robot, loss.fence, "lost", reason=loss.reason))

    def _lease(
        self, request: m.Request | None, robot: str, fence: int, state: str, **more: object
    ) -> m.Lease:
        return answer(m.Lease, request, robot=robot, fence=fence, state=state, ttl=self._leases.ttl, **more)

    def _denied(self, robot: str, denial: Denial) -> str:
        if denial.code is ErrorCode.STOPPED:
            ids = ", ".join(str(stop) for stop in reversed(self._stops(robot)))
            return f"{robot} is stopped (stop {ids}): an operator must reset it, then acquire it again"
        if denial.code is not ErrorCode.LEASED:
            return denial.text
        return f"{robot} is held by {self.holder(robot)}; wait, or take it over as an operator"
