"""State machine of an RSI link.

The table holds every transition; an event without an entry for the current state changes nothing. A link
accepts plans only in ``ready`` and ``moving``. Only an operator's reset leaves ``lost`` and ``faulted``,
always to ``synchronising``: after any disturbance KRC and configuration have to agree again.
"""

from enum import StrEnum

from armgate.events import LinkChange, LinkState, Tick
from armgate.links.link import LinkEvent


class State(StrEnum):
    """State of a link.

    ``waiting``: no telegram has come yet. ``synchronising``: telegrams are answered, no plan is accepted;
    numbers, times and positions have to agree. ``ready``: plans are accepted. ``moving``: a plan is played.
    ``lost``: telegrams stopped, or the KRC's program began anew. ``faulted``: a telegram
    contradicts the configuration or the run so far.
    """

    WAITING = "waiting"
    SYNCHRONISING = "synchronising"
    READY = "ready"
    MOVING = "moving"
    LOST = "lost"
    FAULTED = "faulted"


class Event(StrEnum):
    """Event of a link.

    ``begun``: the first telegram of a run has come. ``agreed``: the KRC fits the configuration. ``moves`` and
    ``rests``: a tick with or without motion. ``held``: the KRC has held the robot. ``gone``: telegrams
    stopped. ``contradicted``: a telegram contradicts the configuration or the run so far. ``rearmed``: an
    operator has reset the stop.
    """

    BEGUN = "begun"
    AGREED = "agreed"
    MOVES = "moves"
    RESTS = "rests"
    HELD = "held"
    GONE = "gone"
    CONTRADICTED = "contradicted"
    REARMED = "rearmed"


ARMED = frozenset({State.SYNCHRONISING, State.READY, State.MOVING})
"""States in which a link can be lost or become faulted."""

ACCEPTING = frozenset({State.READY, State.MOVING})
"""States in which plans are accepted."""

TABLE: dict[tuple[State, Event], State] = {
    (State.WAITING, Event.BEGUN): State.SYNCHRONISING,
    (State.WAITING, Event.CONTRADICTED): State.FAULTED,
    (State.SYNCHRONISING, Event.AGREED): State.READY,
    (State.READY, Event.MOVES): State.MOVING,
    (State.MOVING, Event.RESTS): State.READY,
    (State.MOVING, Event.HELD): State.READY,
    **{(state, Event.GONE): State.LOST for state in sorted(ARMED)},
    **{(state, Event.CONTRADICTED): State.FAULTED for state in sorted(ARMED)},
    (State.LOST, Event.REARMED): State.SYNCHRONISING,
    (State.FAULTED, Event.REARMED): State.SYNCHRONISING,
}


class LinkStates:
    """State of one link, and its unreported changes.

    Args:
        robot: Name of the robot.
    """

    def __init__(self, robot: str) -> None:
        self._robot = robot
        self._unreported: list[LinkChange] = []
        self.state = State.WAITING

    @property
    def armed(self) -> bool:
        """True if the link can be lost or become faulted."""
        return self.state in ARMED

    @property
    def accepts_plans(self) -> bool:
        """True if the robot can be moved."""
        return self.state in ACCEPTING

    def go(self, event: Event) -> bool:
        """Follow the table; return False if the event changes nothing."""
        state = TABLE.get((self.state, event))
        if state is None:
            return False
        self.state = state
        return True

    def ready(self) -> None:
        """Accept plans, and report it."""
        if self.go(Event.AGREED):
            self._unreported.append(LinkChange(self._robot, LinkState.READY))

    def lose(self, reason: str) -> bool:
        """Become lost, and report it; return False if the link cannot be lost."""
        lost = self.go(Event.GONE)
        if lost:
            self._unreported.append(LinkChange(self._robot, LinkState.LOST, reason))
        return lost

    def fault(self, reason: str) -> None:
        """Accept no new plan, and report it; the rest of the held plan is still played and ends at rest."""
        if self.go(Event.CONTRADICTED):
            self._unreported.append(LinkChange(self._robot, LinkState.FAULTED, reason))

    def report(self, tick: Tick | None = None) -> tuple[LinkEvent, ...]:
        """Return the unreported changes: losses and faults before the tick, readiness after it."""
        ready = [change for change in self._unreported if change.state is LinkState.READY]
        others = [change for change in self._unreported if change.state is not LinkState.READY]
        self._unreported.clear()
        return (*others, *(() if tick is None else (tick,)), *ready)
