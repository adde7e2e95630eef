"""Findings of the monitor, their summary, and the labels of the positions that it checks."""

from dataclasses import dataclass, field
from typing import Literal

from armgate.monitor.model import Kind

FindingKind = Literal[
    "clearance",
    "limit",
    "speed",
    "acceleration",
    "stop_end",
    "stray",
    "distance",
    "pace",
    "silence",
    "form",
    "cell",
]
Position = Literal["measured position", "setpoint", "stop end", "braking end"]

POSITIONS: tuple[Position, ...] = ("measured position", "setpoint", "stop end", "braking end")
"""Rows of the poses of a robot: q, setpoint, reported stop end, and the end that the monitor computes."""


@dataclass(frozen=True)
class Finding:
    """Violation of one rule.

    Attributes:
        kind: Rule that is violated.
        robot: The robot in whose state it was found.
        tick: Its tick.
        time: Daemon time, s.
        text: One sentence with the numbers.
        value: Value that was found, in m, rad or s.
        bound: Value that it was compared with.
        pair: Names of the bodies, for a clearance.
        joint: Name of the joint, for a rule about joints.
    """

    kind: FindingKind
    robot: str
    tick: int
    time: float
    text: str
    value: float | None = None
    bound: float | None = None
    pair: tuple[str, str] | None = None
    joint: str | None = None

    def __str__(self) -> str:
        if self.kind == "cell":
            return self.text
        return f"{self.robot}, tick {self.tick} ({self.time:.3f} s): {self.text}"


@dataclass(frozen=True)
class SmallestClearance:
    """Smallest clearance of one kind of pairs: a certified lower bound, its limit, pair, tick and robot."""

    kind: Kind
    distance: float
    limit: float
    pair: tuple[str, str]
    tick: int
    time: float
    robot: str


@dataclass
class Summary:
    """Summary of all checks.

    Attributes:
        states: Number of checked states of robots.
        positions: Number of measured positions, setpoints and ends of stops in them.
        unseen: Robots without any state: they were not checked.
        missed: Number of ticks whose states were not received, by robot.
        retreats: Number of margins that were violated when the monitor started or a robot was moved by hand.
        violations: Number of findings.
        findings: The first of them.
        smallest: Smallest clearance by kind of pairs.
        late: Number of states that the live monitor checked more than 0.5 s late.
        share: CPU time of the live monitor divided by elapsed time; 0 for a recording.
    """

    states: int = 0
    positions: int = 0
    unseen: list[str] = field(default_factory=list)
    missed: dict[str, int] = field(default_factory=dict)
    retreats: int = 0
    violations: int = 0
    findings: list[Finding] = field(default_factory=list)
    smallest: dict[Kind, SmallestClearance] = field(default_factory=dict)
    share: float = 0.0
    late: int = 0
