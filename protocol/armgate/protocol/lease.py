"""State machine of the leases, without clocks or sockets.

A lease is the exclusive right to command one robot. Theory of operation: a lease is ``free``, ``held`` or
``stopped``, and ``TRANSITIONS`` lists the next state for each event. Every grant has a fence, a number larger
than all earlier fences of this robot; a command with an older fence comes from a former holder.

:class:`Leases` holds the leases of all robots of a cell. ``acquire`` returns a :class:`Grant` or a
:class:`Denial`. A grant that ends without a request of its holder is reported once, as a :class:`Loss`.
``now`` is the time of any monotonic clock, s.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import Enum

from armgate.protocol.errors import ErrorCode
from armgate.protocol.messages import Role


class LeaseState(Enum):
    """State of a robot's lease."""

    FREE = "free"
    HELD = "held"
    STOPPED = "stopped"


class LeaseEvent(Enum):
    """Event that can change a lease."""

    ACQUIRE = "acquire"
    """A session requests a free robot."""
    REACQUIRE = "reacquire"
    """The holder requests the robot again: new fence, possibly another speed."""
    TAKEOVER = "takeover"
    """An operator takes the robot over from its holder."""
    RENEW = "renew"
    """The holder sent a message."""
    RELEASE = "release"
    """The holder releases the robot."""
    EXPIRE = "expire"
    """The holder sent nothing for the time to live."""
    DROP = "drop"
    """The holder's connection ended."""
    STOP = "stop"
    """The robot was stopped."""
    RESUME = "resume"
    """The robot's last stop was lifted."""


TRANSITIONS: dict[tuple[LeaseState, LeaseEvent], LeaseState] = {
    (LeaseState.FREE, LeaseEvent.ACQUIRE): LeaseState.HELD,
    (LeaseState.FREE, LeaseEvent.STOP): LeaseState.STOPPED,
    (LeaseState.HELD, LeaseEvent.REACQUIRE): LeaseState.HELD,
    (LeaseState.HELD, LeaseEvent.TAKEOVER): LeaseState.HELD,
    (LeaseState.HELD, LeaseEvent.RENEW): LeaseState.HELD,
    (LeaseState.HELD, LeaseEvent.RELEASE): LeaseState.FREE,
    (LeaseState.HELD, LeaseEvent.EXPIRE): LeaseState.FREE,
    (LeaseState.HELD, LeaseEvent.DROP): LeaseState.FREE,
    (LeaseState.HELD, LeaseEvent.STOP): LeaseState.STOPPED,
    (LeaseState.STOPPED, LeaseEvent.STOP): LeaseState.STOPPED,
    (LeaseState.STOPPED, LeaseEvent.RESUME): LeaseState.FREE,
}
"""Next state by state and event; an event that is not listed for a state has no effect in it."""


@dataclass(frozen=True, slots=True)
class Grant:
    """Granted lease.

    Attributes:
        robot: The robot.
        session: Session that holds the robot.
        fence: Fence, larger than all earlier fences of this robot.
        speed: Speed bound of the holder, a share of the cell's.
        expires: Time at which the lease ends unless it is renewed (at this time it is no longer held).
        displaced: Lease that ended by this grant; None if the robot was free.
    """

    robot: str
    session: str
    fence: int
    speed: float
    expires: float
    displaced: "Loss | None" = None


@dataclass(frozen=True, slots=True)
class Loss:
    """Lease that ended without a request of its holder."""

    robot: str
    session: str
    fence: int
    reason: str


@dataclass(frozen=True, slots=True)
class Denial:
    """Refusal of a lease: code and text of the error to send."""

    code: ErrorCode
    text: str


class Leases:
    """Leases of all robots of a cell.

    A server that was stalled still has to read messages that arrived in time. Therefore a lease expires by
    ``read_until``, the time up to which all messages of clients have been read, and is renewed from ``now``.
    The default of ``read_until`` is ``now``.

    Args:
        robots: Names of the robots.
        ttl: Time to live of a lease without a message of its holder, s.
    """

    def __init__(self, robots: Iterable[str], ttl: float) -> None:
        self.ttl = ttl
        self._states = dict.fromkeys(robots, LeaseState.FREE)
        self._grants: dict[str, Grant] = {}
        # Robots of each session; empty after each change of a holder, because lock-step asks often.
        self._robots: dict[str, frozenset[str]] = {}
        # Counted per robot, so that fences do not depend on the order in which other robots are acquired.
        self._fences = dict.fromkeys(self._states, 0)

    def state(self, robot: str) -> LeaseState:
        """Return the state of a robot's lease (KeyError for an unknown robot)."""
        return self._states[robot]

    def holder(self, robot: str) -> Grant | None:
        """Return the grant in force, as of the last ``expire``; None if the robot is not held."""
        return self._grants.get(robot)

    def held_by(self, session: str) -> list[Grant]:
        """Return all grants of one session."""
        return [grant for grant in self._grants.values() if grant.session == session]

    def robots_of(self, session: str) -> frozenset[str]:
        """Return the robots that one session holds."""
        found = self._robots.get(session)
        if found is None:
            found = frozenset(robot for robot, grant in self._grants.items() if grant.session == session)
            self._robots[session] = found
        return found

    @property
    def sessions(self) -> set[str]:
        """Sessions that hold a robot."""
        return {grant.session for grant in self._grants.values()}

    def holds_any(self, session: str) -> bool:
        """Return True if a session holds a robot."""
        return any(grant.session == session for grant in self._grants.values())

    def holds(self, robot: str, session: str, fence: int, now: float) -> bool:
        """Return True if this is the grant in force at ``now``."""
        grant = self._grants.get(robot)
        return grant is not None and (grant.session, grant.fence) == (session, fence) and now < grant.expires

    def acquire(
        self,
        robot: str,
        session: str,
        role: Role,
        *,
        takeover: bool,
        speed: float,
        now: float,
        read_until: float | None = None,
    ) -> Grant | Denial:
        """Grant the lease if the robot is free, held by this session, or taken over by an operator."""
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
        return self._grant(robot, session, takeover, speed, now, now if read_until is None else read_until)

    def renew(self, session: str, now: float, read_until: float | None = None) -> None:
        """Renew the session's leases that have not expired: the session sent a message."""
        expires = now + self.ttl
        for robot in self.robots_of(session):
            grant = self._grants[robot]
            # Equal in lock-step, in which no lease expires.
            if grant.expires != expires and (now if read_until is None else read_until) < grant.expires:
                self._move(robot, LeaseEvent.RENEW)
                self._grants[robot] = replace(grant, expires=expires)

    def release(self, robot: str, session: str, fence: int, now: float) -> Grant | Denial:
        """Release a lease; return the grant that ended."""
        if robot not in self._states:
            return Denial(
                ErrorCode.UNKNOWN_ROBOT, f"no robot {robot}; the cell has {', '.join(self._states)}"
            )
        if not self.holds(robot, session, fence, now):
            return Denial(ErrorCode.NOT_HELD, f"the session does not hold {robot} with fence {fence}")
        return self._end(robot, LeaseEvent.RELEASE)

    def expire(self, now: float) -> list[Loss]:
        """End the leases whose time to live has passed."""
        over = [grant.robot for grant in self._grants.values() if now >= grant.expires]
        return [self._lose(robot, LeaseEvent.EXPIRE, self._expired) for robot in over]

    def drop(self, session: str) -> list[Loss]:
        """End the leases of a session whose connection ended."""
        robots = [grant.robot for grant in self.held_by(session)]
        self._robots.pop(session, None)
        return [self._lose(robot, LeaseEvent.DROP, "the holder's connection ended") for robot in robots]

    def stop(self, robots: Iterable[str], reason: str) -> list[Loss]:
        """End the leases of stopped robots; no lease is granted until ``resume``."""
        losses = []
        for robot in robots:
            if robot in self._grants:
                losses.append(self._lose(robot, LeaseEvent.STOP, reason))
            else:
                self._move(robot, LeaseEvent.STOP)
        return losses

    def resume(self, robots: Iterable[str]) -> None:
        """Free the leases of robots whose last stop was lifted."""
        for robot in robots:
            self._move(robot, LeaseEvent.RESUME)

    @property
    def _expired(self) -> str:
        return f"the holder sent nothing for {self.ttl:g} s"

    def _grant(
        self, robot: str, session: str, takeover: bool, speed: float, now: float, read_until: float
    ) -> Grant | Denial:
        displaced = None
        held = self._grants.get(robot)
        if held is not None and read_until >= held.expires:
            displaced, held = self._lose(robot, LeaseEvent.EXPIRE, self._expired), None
        if held is None:
            event = LeaseEvent.ACQUIRE
        elif held.session == session:
            event = LeaseEvent.REACQUIRE
        elif takeover:
            event = LeaseEvent.TAKEOVER
            displaced = Loss(robot, held.session, held.fence, "an operator took the robot over")
        else:
            return Denial(ErrorCode.LEASED, f"{robot} is held by another session")
        self._move(robot, event)
        self._fences[robot] += 1
        grant = Grant(robot, session, self._fences[robot], speed, now + self.ttl, displaced)
        self._grants[robot] = replace(grant, displaced=None)
        self._robots.clear()
        return grant

    def _lose(self, robot: str, event: LeaseEvent, reason: str) -> Loss:
        grant = self._end(robot, event)
        return Loss(robot, grant.session, grant.fence, reason)

    def _end(self, robot: str, event: LeaseEvent) -> Grant:
        self._move(robot, event)
        self._robots.clear()
        return self._grants.pop(robot)

    def _move(self, robot: str, event: LeaseEvent) -> None:
        state = self._states[robot]
        self._states[robot] = TRANSITIONS.get((state, event), state)
