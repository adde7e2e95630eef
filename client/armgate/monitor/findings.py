"""Findings of the monitor, and the labels of the positions that it checks."""

from dataclasses import dataclass
from typing import Literal

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
"""Rows of the poses of a robot: q, setpoint, reported end of the stop, and the end by own computation."""


@dataclass(frozen=True)
class Finding:
    """Something that a cell must not show.

    Attributes:
        kind: What is violated.
        robot: The robot whose state shows it.
        tick: Its tick.
        time: Daemon time, s.
        text: One sentence with the numbers.
        value: What was found, m, rad or per s.
        bound: What it was held against.
        pair: The bodies, if a clearance is violated.
        joint: The joint, if one is concerned.
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
