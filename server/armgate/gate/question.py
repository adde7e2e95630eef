"""What is asked of one pair, and what could be proven: questions, answers, and the pieces of an occupancy."""

from dataclasses import dataclass

import numpy as np

from armgate.events import Point
from armgate.gate.groups import ChainGroup, Group
from armgate.gate.screen import MARGIN
from armgate.gate.swept import Array, Index, Swept


@dataclass(frozen=True, slots=True)
class Binding:
    """The pair that an occupancy comes too near to, and what could be proven of it."""

    pair: int
    lb: float
    need: float
    points: tuple[Point, Point] | None


@dataclass(frozen=True, slots=True)
class Question:
    """Does the group's k-th pair keep ``need`` over the occupancy ``new`` of ``robot``?"""

    group: Group
    k: int
    robot: int
    new: Swept
    need: float

    @property
    def sel(self) -> Index:
        """The pair as a selection of its group."""
        return np.array([self.k])

    @property
    def moving(self) -> int | None:
        """The robot at the other side that moves at its own time."""
        return None if isinstance(self.group, ChainGroup) else self.group.other

    def loss(self, side: Swept) -> float:
        """What the tubes alone take from the distance: no subdivision wins it back."""
        loss = self.group.growth[self.k] @ self.new.tube
        if self.moving is not None:
            loss += side.motion[self.group.theirs[self.k]] @ side.tube
        return float(loss) + MARGIN


@dataclass(frozen=True, slots=True)
class Found:
    """The best bound that could be proven, and the witness points (mine, theirs) of the last engine query."""

    lb: float
    points: tuple[Point, Point] | None


def ordered(group: Group, k: int, points: tuple[Point, Point] | None) -> tuple[Point, Point] | None:
    """The witness points in the pair's own order."""
    if points is None or group.sign[k] > 0:
        return points
    return points[1], points[0]


def segments(nodes: Array) -> list[Array]:
    """The polyline's segments, (2, n) each; one node for a robot that stands still."""
    return [nodes[i : i + 2] for i in range(len(nodes) - 1)] or [nodes]


def middle(segment: Array) -> Array:
    """The middle of a segment, (1, n)."""
    return np.asarray(segment.mean(axis=0, keepdims=True))


def halves(segment: Array) -> list[Array]:
    """A segment's halves; itself where it is one node."""
    if len(segment) == 1:
        return [segment]
    between = segment.mean(axis=0)
    return [np.stack([segment[0], between]), np.stack([between, segment[1]])]
