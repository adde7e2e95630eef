"""Stops in force. A repeated stop replaces the one that it repeats, so their number is bounded.

Each stop has an id of its own, larger than all earlier ids. A stop of the same robots for the same cause as
one in force replaces it: only the newer id is in force then, and a reset of either id lifts it. Clients may
stop the same robots for ``MAX_CLIENT_STOPS`` different causes. A further stop replaces the newest one of the
same client, or the newest of all if that client has none. The gate itself has three causes per robot. So at
most 2 · ``MAX_CLIENT_STOPS`` + 3 stops are in force for a robot (its own stops and those of the cell),
for any behaviour of clients and links.
"""

from collections import OrderedDict
from dataclasses import dataclass

MAX_CLIENT_STOPS = 16
"""Largest number of stops of the same robots that clients may have in force."""

REMEMBERED = 4096
"""Replaced ids that a reset may still name; ids replaced earlier are forgotten, the oldest first."""


@dataclass(frozen=True, slots=True)
class StopCause:
    """Cause of a stop: two stops of the same robots with equal causes are one stop.

    Attributes:
        by: Name of the client that sent the stop, "" for the gate itself.
        why: The client's reason, or the kind of the gate's own cause: ``link``, ``fault``, ``met``.
    """

    by: str
    why: str

    @property
    def own(self) -> bool:
        """True if the gate raised the stop by itself."""
        return not self.by


LINK, FAULT, MET = (StopCause("", why) for why in ("link", "fault", "met"))
"""The gate's own causes: link lost or faulted, robot off its stop path, other robot that may meet it."""


@dataclass(slots=True)
class StopInForce:
    """A stop in force, with the id of the newest stop that was merged into it.

    Attributes:
        id: The id that a reset names.
        robots: Indices of the robots.
        cause: Cause of the newest stop that was merged into it.
    """

    id: int
    robots: tuple[int, ...]
    cause: StopCause


class Stops:
    """All stops of a cell."""

    def __init__(self) -> None:
        self.next = 1
        self._in_force: dict[int, StopInForce] = {}
        self._replaced: OrderedDict[int, StopInForce] = OrderedDict()

    def raise_(self, robots: tuple[int, ...], cause: StopCause) -> tuple[int, int | None]:
        """Put a stop in force.

        Returns:
            Its id, and the id that it replaces, None if it replaces none.
        """
        replaced = self._to_replace(robots, cause)
        return self.put(self.next, robots, cause, replaced), replaced

    def put(self, id_: int, robots: tuple[int, ...], cause: StopCause, replaces: int | None) -> int:
        """Put a stop in force under an id, in place of the one with the id ``replaces``; return its id."""
        self.next = id_ + 1
        stop = None if replaces is None else self._in_force.pop(replaces, None)
        if stop is None:
            stop = StopInForce(id_, robots, cause)
        else:
            self._replaced[stop.id] = stop
            stop.id, stop.cause = id_, cause
        self._in_force[id_] = stop
        if len(self._replaced) > REMEMBERED:
            self._replaced.popitem(last=False)
        return id_

    def find(self, id_: int) -> StopInForce | None:
        """Return the stop in force that an id names, also if it was replaced; None if there is none."""
        return self._in_force.get(id_) or self._replaced.get(id_)

    def lift(self, stop: StopInForce) -> None:
        """End a stop: none of its ids is in force any more."""
        del self._in_force[stop.id]
        for old in [old for old, other in self._replaced.items() if other is stop]:
            del self._replaced[old]

    def of(self, robot: int) -> list[int]:
        """Return the ids in force for a robot, ascending."""
        return [stop.id for stop in self._in_force.values() if robot in stop.robots]

    def _to_replace(self, robots: tuple[int, ...], cause: StopCause) -> int | None:
        same = [stop for stop in self._in_force.values() if stop.robots == robots]
        equal = [stop.id for stop in same if stop.cause == cause]
        if equal:
            return equal[0]
        of_clients = [stop for stop in same if not stop.cause.own]
        if cause.own or len(of_clients) < MAX_CLIENT_STOPS:
            return None
        return max(of_clients, key=lambda stop: (stop.cause.by == cause.by, stop.id)).id
