"""Leases: the exclusive right to command one robot, as a table, without clocks or sockets.

A robot is ``free``, ``held`` or ``stopped``; ``TRANSITIONS`` says what each event makes of it. Every grant
has a fence, a number larger than every one before it on this robot: a command with an older fence is from a
former holder.

:class:`Leases` keeps all robots of a cell. ``acquire`` answers a :class:`Grant` or a :class:`Denial`;
whatever ends a grant without its holder's wish is told as a :class:`Loss`, once. ``now`` is any clock that
does not go back, in s.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import Enum

from armgate.protocol.errors import ErrorCode
from armgate.protocol.messages import Role


class LeaseState(Enum):
    """What a robot's lease is."""

    FREE = "free"
    HELD = "held"
    STOPPED = "stopped"


class LeaseEvent(Enum):
    """What can happen to it."""

    ACQUIRE = "acquire"
    """A session asks while nobody holds the robot."""
    AGAIN = "again"
    """The holder itself asks again: a new fence, maybe another speed."""
    TAKEOVER = "takeover"
    """An operator takes it from its holder."""
    RENEW = "renew"
    """The holder gave a sign of life."""
    RELEASE = "release"
    """The holder gives it back."""
    EXPIRE = "expire"
    """The holder was silent for the time to live."""
    DROP = "drop"
    """The holder's connection is gone."""
    STOP = "stop"
    """The robot was stopped."""
    RESUME = "resume"
    """The robot's last stop was lifted."""


TRANSITIONS: dict[tuple[LeaseState, LeaseEvent], LeaseState] = {
    (LeaseState.FREE, LeaseEvent.ACQUIRE): LeaseState.HELD,
    (LeaseState.FREE, LeaseEvent.STOP): LeaseState.STOPPED,
    (LeaseState.HELD, LeaseEvent.AGAIN): LeaseState.HELD,
    (LeaseState.HELD, LeaseEvent.TAKEOVER): LeaseState.HELD,
    (LeaseState.HELD, LeaseEvent.RENEW): LeaseState.HELD,
    (LeaseState.HELD, LeaseEvent.RELEASE): LeaseState.FREE,
    (LeaseState.HELD, LeaseEvent.EXPIRE): LeaseState.FREE,
    (LeaseState.HELD, LeaseEvent.DROP): LeaseState.FREE,
    (LeaseState.HELD, LeaseEvent.STOP): LeaseState.STOPPED,
    (LeaseState.STOPPED, LeaseEvent.STOP): LeaseState.STOPPED,
    (LeaseState.STOPPED, LeaseEvent.RESUME): LeaseState.FREE,
}
"""All that can happen: an event that is not in here for a state has no effect there."""


@dataclass(frozen=True, slots=True)
class Grant:
    """A lease as it was given.

    Attributes:
        robot: The robot.
        session: Who holds it.
        fence: Larger than every fence before on this robot.
        speed: The holder's own speed bound, a fraction of the cell's.
        expires: When it ends unless renewed (held until then, not at it).
        displaced: Whose lease ended by this one, None if the robot was free.
    """

    robot: str
    session: str
    fence: int
    speed: float
    expires: float
    displaced: "Loss | None" = None


@dataclass(frozen=True, slots=True)
class Loss:
    """A lease that ended without its holder's wish."""

    robot: str
    session: str
    fence: int
    reason: str


@dataclass(frozen=True, slots=True)
class Denial:
    """Why a lease was not given: the code and text of the error to answer."""

    code: ErrorCode
    text: str


class Leases:
    """The leases of all robots of a cell.

    A server that was stalled has messages to read that came in time. So a lease ends by ``heard``, the time
    up to which everything that clients sent has been read, and is renewed from ``now``. If only ``now`` is
    given, both are the same.

    Args:
        robots: Their names.
        ttl: Time to live of a lease without a sign of life from its holder, s.
    """

    def __init__(self, robots: Iterable[str], ttl: float) -> None:
        self.ttl = ttl
        self._states = dict.fromkeys(robots, LeaseState.FREE)
        self._grants: dict[str, Grant] = {}
        # Counted per robot: the numbers do not depend on who took another robot first.
        self._fences = dict.fromkeys(self._states, 0)

    def state(self, robot: str) -> LeaseState:
        """What the robot's lease is (KeyError for a robot that is not in the cell)."""
        return self._states[robot]

    def holder(self, robot: str) -> Grant | None:
        """The grant in force, as of the last ``expire``."""
        return self._grants.get(robot)

    def held_by(self, session: str) -> list[Grant]:
        """All grants of one session."""
        return [grant for grant in self._grants.values() if grant.session == session]

    @property
    def sessions(self) -> set[str]:
        """All sessions that hold a robot."""
        return {grant.session for grant in self._grants.values()}

    def holds(self, robot: str, session: str, fence: int, now: float) -> bool:
        """Whether this is the grant in force at ``now``."""
        grant = self._grants.get(robot)
        return grant is not None and (grant.session, grant.fence) == (session, fence) and now < grant.expires

    def next_expiry(self) -> float | None:
        """When the next lease ends if nothing renews it; None if none is held."""
        return min((grant.expires for grant in self._grants.values()), default=None)

    def acquire(
        self,
        robot: str,
        session: str,
        role: Role,
        *,
        takeover: bool,
        speed: float,
        now: float,
        heard: float | None = None,
    ) -> Grant | Denial:
        """Gives the lease, if the robot is free, the session's own, or an operator takes it over."""
        if robot not in self._states:
            return Denial(
                ErrorCode.UNKNOWN_ROBOT, f"no robot {robot}; the cell has {', '.join(self._states)}"
            )
        if role == "observer":
            return Denial(ErrorCode.FORBIDDEN, f"an observer cannot hold {robot}; connect as a controller")
        if takeover and role != "operator":
            return Denial(ErrorCode.FORBIDDEN, f"only an operator can take {robot} over, not a {role}")
        if self._states[robot] is LeaseState.STOPPED:
            return Denial(ErrorCode.STOPPED, f"{robot} is stopped; an operator must reset the stop first")
        return self._grant(robot, session, takeover, speed, now, now if heard is None else heard)

    def renew(self, session: str, now: float, heard: float | None = None) -> None:
        """The session gave a sign of life: its leases that have not expired live on."""
        for grant in self.held_by(session):
            if (now if heard is None else heard) < grant.expires:
                self._move(grant.robot, LeaseEvent.RENEW)
                self._grants[grant.robot] = replace(grant, expires=now + self.ttl)

    def release(self, robot: str, session: str, fence: int, now: float) -> Grant | Denial:
        """Gives a lease back; answers the grant that ended."""
        if robot not in self._states:
            return Denial(
                ErrorCode.UNKNOWN_ROBOT, f"no robot {robot}; the cell has {', '.join(self._states)}"
            )
        if not self.holds(robot, session, fence, now):
            return Denial(ErrorCode.NOT_HELD, f"the session does not hold {robot} with fence {fence}")
        return self._end(robot, LeaseEvent.RELEASE)

    def expire(self, now: float) -> list[Loss]:
        """Ends the leases whose time is over."""
        over = [grant.robot for grant in self._grants.values() if now >= grant.expires]
        return [self._lose(robot, LeaseEvent.EXPIRE, self._silent) for robot in over]

    def drop(self, session: str) -> list[Loss]:
        """The session is gone: ends its leases."""
        robots = [grant.robot for grant in self.held_by(session)]
        return [self._lose(robot, LeaseEvent.DROP, "its connection is gone") for robot in robots]

    def stop(self, robots: Iterable[str], reason: str) -> list[Loss]:
        """The robots were stopped: ends their leases; none is given until ``resume``."""
        losses = []
        for robot in robots:
            if robot in self._grants:
                losses.append(self._lose(robot, LeaseEvent.STOP, reason))
            else:
                self._move(robot, LeaseEvent.STOP)
        return losses

    def resume(self, robots: Iterable[str]) -> None:
        """No stop is in force any more for these robots: their leases may be taken again."""
        for robot in robots:
            self._move(robot, LeaseEvent.RESUME)

    @property
    def _silent(self) -> str:
        return f"no sign of life from its holder for {self.ttl:g} s"

    def _grant(
        self, robot: str, session: str, takeover: bool, speed: float, now: float, heard: float
    ) -> Grant | Denial:
        displaced = None
        held = self._grants.get(robot)
        if held is not None and heard >= held.expires:
            displaced, held = self._lose(robot, LeaseEvent.EXPIRE, self._silent), None
        if held is None:
            event = LeaseEvent.ACQUIRE
        elif held.session == session:
            event = LeaseEvent.AGAIN
        elif takeover:
            event = LeaseEvent.TAKEOVER
            displaced = Loss(robot, held.session, held.fence, "an operator took it over")
        else:
            return Denial(ErrorCode.LEASED, f"{robot} is held by another session")
        self._move(robot, event)
        self._fences[robot] += 1
        grant = Grant(robot, session, self._fences[robot], speed, now + self.ttl, displaced)
        self._grants[robot] = replace(grant, displaced=None)
        return grant

    def _lose(self, robot: str, event: LeaseEvent, reason: str) -> Loss:
        grant = self._end(robot, event)
        return Loss(robot, grant.session, grant.fence, reason)

    def _end(self, robot: str, event: LeaseEvent) -> Grant:
        self._move(robot, event)
        return self._grants.pop(robot)

    def _move(self, robot: str, event: LeaseEvent) -> None:
        state = self._states[robot]
        self._states[robot] = TRANSITIONS.get((state, event), state)
