"""Bounds on the number of connections, in total and per address, and places reserved for higher roles.

A connection is *waiting* until its hello is accepted; then it is a *session*. A waiting connection never
takes the place of a session, and waiting connections cannot block new ones: if the limit is reached, a
waiting connection is closed to make room, if possible one that has sent nothing, otherwise the oldest. A part
of each limit is reserved for operators, and another for operators and controllers, so that observers or
controllers cannot use up all places. Observers with one token have the same limit as those of one address,
even if they connect from several addresses.
"""

from collections import Counter
from dataclasses import dataclass, field

from armgate.protocol.messages import Role

_RESERVED = 16
"""Divisor of a limit: limit // _RESERVED places are reserved for operators.

As many more are reserved for operators and controllers.
"""

_BELOW: dict[Role, int] = {"operator": 0, "controller": 1, "observer": 2}
"""Number of roles above each role, which is the number of reserved parts that it may not use."""


@dataclass(eq=False, slots=True)
class Slot:
    """Place of one connection.

    Attributes:
        origin: Address to which it is attributed.
        uid: User at its other end; None if it does not use the Unix socket.
        refusal: Reason why it may not stay; empty if it may.
        silent: True until the client has sent something.
        identity: Token to which its session is attributed; empty while it waits, or without a token.
        role: Role of its session; None while it waits.
    """

    origin: str
    uid: int | None = None
    refusal: str = ""
    silent: bool = True
    identity: str = ""
    role: Role | None = field(default=None)

    def note_data(self) -> None:
        """Note that the client has sent something."""
        self.silent = False


class ConnectionLimits:
    """Counter of connections, with limits.

    Args:
        in_all: Largest number of connections.
        per_origin: Largest number of connections from one origin, and of one token.
    """

    def __init__(self, in_all: int, per_origin: int) -> None:
        self._in_all = in_all
        self._per_origin = per_origin
        self._waiting: dict[Slot, None] = {}
        self._sessions: set[Slot] = set()

    def enter(self, origin: str, uid: int | None = None) -> tuple[Slot, Slot | None]:
        """Return the slot of a new connection, and a waiting connection to close for it, or None."""
        slot, evicted = Slot(origin, uid), None
        if self._from(origin) >= self._per_origin:
            evicted = self._oldest(origin)
            if evicted is None:
                slot.refusal = self._full_address()
                return slot, None
        elif len(self._waiting) + len(self._sessions) >= self._in_all:
            evicted = self._oldest(self._crowded())
            if evicted is None:
                slot.refusal = self._full()
                return slot, None
        if evicted is not None:
            self.leave(evicted)
        self._waiting[slot] = None
        return slot, evicted

    def admit(self, slot: Slot, role: Role, identity: str) -> str:
        """Turn a waiting connection into a session.

        Args:
            slot: The connection's slot.
            role: Role that its hello was granted.
            identity: Name of its token; empty without one.

        Returns:
            Reason why there is no place for it; empty if there is.
        """
        others = [one for one in self._sessions if _BELOW[one.role or "observer"] >= _BELOW[role]]
        if len(others) >= self._bound(self._in_all, role):
            return self._full()
        bound = self._bound(self._per_origin, role)
        if sum(one.origin == slot.origin for one in others) >= bound:
            return self._full_address()
        if identity and sum(one.identity == identity for one in others) >= bound:
            return f"there are {self._per_origin} connections with your token already; close some"
        self._waiting.pop(slot, None)
        slot.role, slot.identity = role, identity
        self._sessions.add(slot)
        return ""

    def leave(self, slot: Slot) -> None:
        """Free the place of a connection."""
        self._waiting.pop(slot, None)
        self._sessions.discard(slot)

    @property
    def empty(self) -> bool:
        """True if there is no connection."""
        return not self._waiting and not self._sessions

    def _from(self, origin: str) -> int:
        return sum(slot.origin == origin for slot in (*self._waiting, *self._sessions))

    def _oldest(self, origin: str) -> Slot | None:
        """Return the oldest waiting connection of an origin, if possible one that has sent nothing."""
        waiting = [slot for slot in self._waiting if slot.origin == origin]
        return next((slot for slot in waiting if slot.silent), waiting[0] if waiting else None)

    def _crowded(self) -> str:
        """Return the origin with the most waiting connections."""
        counts = Counter(slot.origin for slot in self._waiting)
        return max(counts, key=counts.__getitem__, default="")

    @staticmethod
    def _bound(limit: int, role: Role) -> int:
        return limit - _BELOW[role] * (limit // _RESERVED)

    def _full(self) -> str:
        return (
            f"all {self._in_all} places for connections are taken, or all that your role may use; "
            "try again later"
        )

    def _full_address(self) -> str:
        return (
            f"all {self._per_origin} places for connections from your address are taken, or all that your "
            "role may use; close some"
        )
