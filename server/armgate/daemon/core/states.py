"""The newest state of every robot, for those who ask now and those who subscribed."""

from collections.abc import Sequence
from typing import Any

from armgate.daemon.core.peer import Encoded, Subscription
from armgate.events import Tick
from armgate.protocol import ErrorCode, RemoteProtocolError, encode
from armgate.protocol import messages as m

FIELDS: tuple[str, ...] = tuple(
    name for name in m.Entry.model_fields if name not in ("robot", "tick", "time")
)
"""What an entry may hold beside robot, tick and time, in the order of the message."""


class LatestState:
    """One robot's newest state; each set of fields is encoded once for all clients."""

    def __init__(self, state: m.State) -> None:
        self._state = state
        self._encoded: dict[tuple[str, ...], Encoded] = {}

    def of(self, fields: tuple[str, ...]) -> Encoded:
        """The state with these fields."""
        known = self._encoded.get(fields)
        if known is None:
            state = self._state if fields == FIELDS else _selected(self._state, fields)
            known = self._encoded[fields] = Encoded(state, encode(state))
        return known


class LatestStates:
    """Keeps the newest states.

    Args:
        robots: Names, in the order of the configuration.
    """

    def __init__(self, robots: Sequence[str]) -> None:
        self._robots = tuple(robots)
        self._newest: dict[str, LatestState] = {}

    def subscription(self, request: m.Subscribe) -> Subscription:
        """The subscription that a request asks for.

        Raises:
            RemoteProtocolError: ``unknown_robot`` or ``unknown_field``; the text lists what there is.
        """
        robots = self._robots if request.robots is None else request.robots
        fields = FIELDS if request.fields is None else request.fields
        _all_known("robot", robots, self._robots, ErrorCode.UNKNOWN_ROBOT)
        _all_known("field", fields, FIELDS, ErrorCode.UNKNOWN_FIELD)
        return Subscription(request.every, frozenset(robots), tuple(f for f in FIELDS if f in fields))

    def subscribed_robots(self, subscription: Subscription) -> tuple[str, ...]:
        """The robots of a subscription, in the order of the configuration."""
        return tuple(robot for robot in self._robots if robot in subscription.robots)

    def put(
        self,
        tick: Tick,
        entries: tuple[m.Entry, ...],
        signals: dict[str, m.SignalValue],
        warnings: tuple[str, ...],
        step: int | None,
    ) -> None:
        """Note the state at a tick."""
        # The parts are validated already: a second look at each would cost more than all the rest.
        fields: dict[str, Any] = {} if step is None else {"step": step}
        state = m.State.model_construct(
            robot=tick.robot,
            tick=tick.tick,
            time=tick.time,
            entries=entries,
            signals=signals,
            warnings=warnings,
            **fields,
        )
        self._newest[tick.robot] = LatestState(state)

    def newest(self, robot: str) -> LatestState | None:
        """Return the newest state at a tick of ``robot``; None before its first."""
        return self._newest.get(robot)


def _selected(state: m.State, fields: tuple[str, ...]) -> m.State:
    wanted = ("robot", "tick", "time", *fields)
    entries = tuple(
        m.Entry.model_construct(**{name: getattr(entry, name) for name in wanted}) for entry in state.entries
    )
    return state.model_copy(update={"entries": entries})


def _all_known(what: str, given: Sequence[str], known: Sequence[str], code: ErrorCode) -> None:
    strange = [name for name in given if name not in known]
    if strange:
        text = f"no {what} {', '.join(strange)}; there are {', '.join(known)}"
        raise RemoteProtocolError(code, text, about="subscribe")
