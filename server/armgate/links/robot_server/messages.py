"""What daemon and robot server tell each other, beside the events of `armgate.events`."""

from dataclasses import dataclass

from armgate.events import LinkChange, Plan, PlanAnswer, Rebase, Tick

FORMAT = 1
"""Grows with every change of what goes over the socket: both sides come from one release."""


@dataclass(frozen=True, slots=True)
class Standing:
    """Where a daemon stands with a robot.

    Attributes:
        robot: Its name.
        tick: The number that its next tick shall have.
        resets: How often it was rebased.
    """

    robot: str
    tick: int
    resets: int


@dataclass(frozen=True, slots=True)
class Hello:
    """A daemon's first words: what it speaks, its cell's hash, its start id, and its robots in order."""

    format: int
    cell: str
    start: str
    robots: tuple[Standing, ...]


@dataclass(frozen=True, slots=True)
class Welcome:
    """The daemon holds the robots now."""

    format: int


@dataclass(frozen=True, slots=True)
class Refusal:
    """The daemon does not get the robots; the connection ends."""

    text: str


@dataclass(frozen=True, slots=True)
class Beat:
    """A sign of life."""


@dataclass(frozen=True, slots=True)
class Played:
    """A tick, with what the daemon cannot know of it.

    Attributes:
        event: The tick; its time is that of the machine's monotonic clock, s.
        resets: How often the robot was rebased before this tick.
        remaining: How many increments were left to play after it.
    """

    event: Tick
    resets: int
    remaining: int


Up = Welcome | Refusal | Beat | Played | LinkChange | PlanAnswer
Down = Hello | Beat | Plan | Rebase
Message = Up | Down
