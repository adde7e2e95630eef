"""Messages between daemon and robot server, in addition to the events of `armgate.events`."""

from dataclasses import dataclass

from armgate.events import LinkChange, Plan, PlanAnswer, Rebase, Tick

FORMAT = 1
"""Version of the messages; both sides come from the same release, and any other version is refused."""


@dataclass(frozen=True, slots=True)
class ResumePoint:
    """Point from which a daemon continues with a robot.

    Attributes:
        robot: Name of the robot.
        tick: Number that its next tick gets.
        resets: Number of rebases so far.
    """

    robot: str
    tick: int
    resets: int


@dataclass(frozen=True, slots=True)
class Hello:
    """First message of a daemon: format, hash of its cell, its start id, its robots in order."""

    format: int
    cell: str
    start: str
    robots: tuple[ResumePoint, ...]


@dataclass(frozen=True, slots=True)
class Welcome:
    """Acceptance of the daemon: from now on it receives ticks and may send plans."""

    format: int


@dataclass(frozen=True, slots=True)
class Refusal:
    """Refusal of the daemon, or of one of its messages; the connection is then closed."""

    text: str


@dataclass(frozen=True, slots=True)
class Heartbeat:
    """Sign of life, sent by both sides."""


@dataclass(frozen=True, slots=True)
class TickReport:
    """Tick of a robot, with the data that the daemon needs to follow the robot's plan.

    Attributes:
        event: The tick; its time is that of the machine's monotonic clock, s.
        resets: Number of rebases before this tick.
        remaining: Number of increments left to play after it.
    """

    event: Tick
    resets: int
    remaining: int


ToDaemon = Welcome | Refusal | Heartbeat | TickReport | LinkChange | PlanAnswer
ToServer = Hello | Heartbeat | Plan | Rebase
Message = ToDaemon | ToServer
