"""Leases in force: effects of a lease that is acquired, taken over, released, lost or expires.

`Leases` of the protocol decides which session holds which robot. Each method here returns its effects in
order, a `LeaseChange` for the gate or a `Notice` for a client, and the core carries them out. A robot whose
lease ends plays its plan to rest, because the gate admits no command without a lease.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

from armgate.events import LeaseChange
from armgate.protocol import Denial, ErrorCode, Grant, Leases, Loss, RemoteProtocolError
from armgate.protocol import messages as m
from armgate.world.interfaces import Peer
from armgate.world.to_protocol import answer


@dataclass(frozen=True, slots=True)
class LeaseTime:
    """Times of renewal and expiry of leases.

    Attributes:
        now: Daemon time, s; renewed leases count from it.
        read: Time up to which all messages of clients have been read, s; leases expire by it.
    """

    now: float
    read: float


_NO_EXPIRY = LeaseTime(0.0, 0.0)


def no_expiry() -> LeaseTime:
    """Return the time of leases in lock-step: leases do not expire, the barrier drops silent clients."""
    return _NO_EXPIRY


@dataclass(frozen=True, slots=True)
class Notice:
    """A message about a lease to one client."""

    peer: Peer
    message: m.Lease


Effect = LeaseChange | Notice


class Leasing:
    """Leases of all robots.

    Args:
        leases: The state machine.
        peers: Sessions by id.
        stops: Returns the stops in force for a robot.
    """

    def __init__(
        self, leases: Leases, peers: Mapping[str, Peer], stops: Callable[[str], Sequence[int]]
    ) -> None:
        self._leases = leases
        self._peers = peers
        self._stops = stops

    def holder(self, robot: str) -> str | None:
        """Return the name of the holder; None if the robot is free."""
        grant = self._leases.holder(robot)
        return None if grant is None else self._peers[grant.session].client.name

    def held_by(self, session: str) -> frozenset[str]:
        """Return the robots that a session holds."""
        return self._leases.robots_of(session)

    def holds(self, session: str) -> bool:
        """Return True if the session holds a robot."""
        return self._leases.holds_any(session)

    @property
    def sessions(self) -> set[str]:
        """The sessions that hold a robot."""
        return self._leases.sessions

    def is_holder(self, session: str, robot: str) -> bool:
        """Return True if the session holds the robot; call `expire` first."""
        grant = self._leases.holder(robot)
        return grant is not None and grant.session == session

    def renew(self, peer: Peer, time: LeaseTime) -> None:
        """Renew the leases of a session whose client sent a message."""
        self._leases.renew(peer.client.id, time.now, time.read)

    # --- changes ------------------------------------------------------------------------------------------

    def acquire(self, peer: Peer, request: m.Acquire, time: LeaseTime) -> list[Effect]:
        """Grant a lease.

        Raises:
            RemoteProtocolError: The lease is denied.
        """
        granted = self._leases.acquire(
            request.robot,
            peer.client.id,
            peer.client.role,
            takeover=request.takeover,
            speed=request.speed,
            now=time.now,
            read_until=time.read,
        )
        if isinstance(granted, Denial):
            raise RemoteProtocolError(granted.code, self._denied(request.robot, granted), about="acquire")
        return [*self._notices(granted), self._change(granted), self._held(peer, request, granted)]

    def release(self, peer: Peer, request: m.Release, time: LeaseTime) -> list[Effect]:
        """End a lease on behalf of its holder.

        Raises:
            RemoteProtocolError: The session does not hold the robot by this fence.
        """
        ended = self._leases.release(request.robot, peer.client.id, request.fence, time.read)
        if isinstance(ended, Denial):
            raise RemoteProtocolError(ended.code, ended.text, about="release")
        released = self._lease(request, request.robot, request.fence, "released")
        return [LeaseChange(request.robot, None), Notice(peer, released)]

    def expire(self, time: LeaseTime) -> list[Effect]:
        """End the leases whose holders sent no message for the time to live."""
        return self._lost(self._leases.expire(time.read))

    def leave(self, peer: Peer) -> list[Effect]:
        """End the leases of a session that has ended."""
        return self._lost(self._leases.drop(peer.client.id))

    def stop(self, robots: Iterable[str], reason: str) -> list[Effect]:
        """End the leases of stopped robots; they cannot be acquired until `resume`."""
        return self._lost(self._leases.stop(robots, reason))

    def resume(self, robots: Iterable[str]) -> None:
        """Make robots available again after the reset of their last stop."""
        self._leases.resume(robots)

    # --- messages -----------------------------------------------------------------------------------------

    def _lost(self, losses: Iterable[Loss]) -> list[Effect]:
        effects: list[Effect] = []
        for loss in losses:
            effects.append(LeaseChange(loss.robot, None))
            effects += self._notice_of(loss)
        return effects

    def _notices(self, granted: Grant) -> list[Notice]:
        return [] if granted.displaced is None else self._notice_of(granted.displaced)

    def _notice_of(self, loss: Loss) -> list[Notice]:
        peer = self._peers.get(loss.session)
        if peer is None:
            return []
        return [Notice(peer, self._lease(None, loss.robot, loss.fence, "lost", reason=loss.reason))]

    @staticmethod
    def _change(granted: Grant) -> LeaseChange:
        return LeaseChange(granted.robot, granted.fence, granted.speed)

    def _held(self, peer: Peer, request: m.Acquire, granted: Grant) -> Notice:
        return Notice(peer, self._lease(request, granted.robot, granted.fence, "held", speed=granted.speed))

    def _lease(
        self, request: m.Request | None, robot: str, fence: int, state: str, **more: object
    ) -> m.Lease:
        return answer(m.Lease, request, robot=robot, fence=fence, state=state, ttl=self._leases.ttl, **more)

    def _denied(self, robot: str, denial: Denial) -> str:
        match denial.code:
            case ErrorCode.STOPPED:
                ids = ", ".join(str(stop) for stop in reversed(self._stops(robot)))
                reset = "an operator must reset the stop; then acquire the robot again"
                return f"{robot} is stopped (stop {ids}): {reset}"
            case ErrorCode.LEASED:
                return f"{robot} is held by {self.holder(robot)}; wait, or take it over as an operator"
            case _:
                return denial.text
