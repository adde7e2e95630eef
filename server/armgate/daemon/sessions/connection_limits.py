"""Bounds on connections: how many there may be, in all and from one address, and whose place is kept.

A connection is *waiting* until its hello is accepted, then it is a *session*. Waiting connections never take
the place of a session, and no number of them keeps a new connection out: if there is no room, a waiting
connection makes room, first one that has sent nothing, then the one that came first. Of each bound a part is
kept for operators, and another for operators and controllers, so that observers or controllers cannot fill
it. Observers of one token, wherever they connect from, have the same bound as those of one address.
"""

from collections import Counter
from dataclasses import dataclass, field

from armgate.protocol.messages import Role

_KEPT = 16
"""One place of so many is kept for operators, and one more for operators and controllers."""

_BELOW: dict[Role, int] = {"operator": 0, "controller": 1, "observer": 2}


@dataclass(eq=False, slots=True)
class Slot:
    """A connection's place.

    Attributes:
        origin: The address that it counts for.
        uid: The user at its other end, None if it does not come over the Unix socket.
        refusal: Why it may not stay; empty if it may.
        silent: True until it has sent something.
        identity: The token that its session counts for; empty while it waits or has none.
        role: The role of its session; None while it waits.
    """

    origin: str
    uid: int | None = None
    refusal: str = ""
    silent: bool = True
    identity: str = ""
    role: Role | None = field(default=None)


class ConnectionLimits:
    """Counts connections.

    Args:
        in_all: How many there may be at once.
        per_origin: How many of them from one origin, and of one token.
    """

    def __init__(self, in_all: int, per_origin: int) -> None:
        self._in_all = in_all
        self._per_origin = per_origin
        self._waiting: dict[Slot, None] = {}
        self._sessions: set[Slot] = set()

    def enter(self, origin: str, uid: int | None = None) -> tuple[Slot, Slot | None]:
        """Return the place of a new connection, and the waiting one that makes room for it, if any."""
        guest, evicted = Slot(origin, uid), None
        if self._from(origin) >= self._per_origin:
            evicted = self._oldest(origin)
            if evicted is None:
                guest.refusal = self._full_address()
                return guest, None
        elif len(self._waiting) + len(self._sessions) >= self._in_all:
            evicted = self._oldest(self._crowded())
            if evicted is None:
                guest.refusal = self._full()
                return guest, None
        if evicted is not None:
            self.leave(evicted)
        self._waiting[guest] = None
        return guest, evicted

    def admit(self, guest: Slot, role: Role, identity: str) -> str:
        """Make a session of a waiting connection.

        Args:
            guest: The connection's place.
            role: The role that its hello is accepted in.
            identity: The token that it came in by; empty without one.

        Returns:
            Why there is no room for it; empty if there is.
        """
        others = [one for one in self._sessions if _BELOW[one.role or "observer"] >= _BELOW[role]]
        if len(others) >= self._bound(self._in_all, role):
            return self._full()
        if sum(one.origin == guest.origin for one in others) >= self._bound(self._per_origin, role):
            return self._full_address()
        if identity and sum(one.identity == identity for one in others) >= self._bound(
            self._per_origin, role
        ):
            return f"there are {self._per_origin} connections with your token already; close some"
        self._waiting.pop(guest, None)
        guest.role, guest.identity = role, identity
        self._sessions.add(guest)
        return ""

    def leave(self, guest: Slot) -> None:
        """Free the place of a connection."""
        self._waiting.pop(guest, None)
        self._sessions.discard(guest)

    @property
    def empty(self) -> bool:
        """True if there is no connection."""
        return not self._waiting and not self._sessions

    def _from(self, origin: str) -> int:
        return sum(guest.origin == origin for guest in (*self._waiting, *self._sessions))

    def _oldest(self, origin: str) -> Slot | None:
        """Return the waiting connection of an origin that came first, if there is one a silent one."""
        waiting = [guest for guest in self._waiting if guest.origin == origin]
        return next((guest for guest in waiting if guest.silent), waiting[0] if waiting else None)

    def _crowded(self) -> str:
        """Return the origin with most waiting connections."""
        counts = Counter(guest.origin for guest in self._waiting)
        return max(counts, key=counts.__getitem__, default="")

    @staticmethod
    def _bound(limit: int, role: Role) -> int:
        return limit - _BELOW[role] * (limit // _KEPT)

    def _full(self) -> str:
        return (
            f"there are {self._in_all} connections already, or all but those kept for higher roles; try later"
        )

    def _full_address(self) -> str:
        return (
            f"there are {self._per_origin} connections from your address already, or all but those kept for "
            "higher roles; close some"
        )
