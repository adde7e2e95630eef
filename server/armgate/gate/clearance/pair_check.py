"""Check of one pair: the distance that it must keep, the bound found for it, and parts of an occupancy."""

from dataclasses import dataclass

import numpy as np

from armgate.events import Point
from armgate.gate.clearance.pair_groups import ChainGroup, Group
from armgate.gate.clearance.prefilter import MARGIN
from armgate.gate.clearance.swept import Array, Index, Swept


@dataclass(frozen=True, slots=True)
class Binding:
    """Pair whose distance is too small: its proven bound, the distance to keep, and witness points."""

    pair: int
    lb: float
    need: float
    points: tuple[Point, Point] | None


@dataclass(frozen=True, slots=True)
class PairCheck:
    """The k-th pair of a group, which must keep ``need`` over the occupancy ``new`` of ``robot``."""

    group: Group
    k: int
    robot: int
    new: Swept
    need: float

    @property
    def sel(self) -> Index:
        """Selection of the pair in its group."""
        return np.array([self.k])

    @property
    def moving(self) -> int | None:
        """Robot at the other side that moves independently; None if there is none."""
        return None if isinstance(self.group, ChainGroup) else self.group.other

    def loss(self, side: Swept) -> float:
        """Return the part of the distance that the tubes take; subdivision cannot reduce it."""
        loss = self.group.growth[self.k] @ self.new.tube
        if self.moving is not None:
            loss += side.motion[self.group.theirs[self.k]] @ side.tube
        return float(loss) + MARGIN


@dataclass(frozen=True, slots=True)
class PairBound:
    """The best bound that could be proven, and the witness points (mine, theirs) of the last engine query."""

    lb: float
    points: tuple[Point, Point] | None


def in_pair_order(group: Group, k: int, points: tuple[Point, Point] | None) -> tuple[Point, Point] | None:
    """Return witness points (mine, theirs) in the order of the pair's bodies."""
    if points is None or group.sign[k] > 0:
        return points
    return points[1], points[0]


def segments(nodes: Array) -> list[Array]:
    """Return the segments of a polyline, (2, n) each; one node if the robot stands still."""
    return [nodes[i : i + 2] for i in range(len(nodes) - 1)] or [nodes]


def middle(segment: Array) -> Array:
    """Return the middle of a segment, (1, n)."""
    return np.asarray(segment.mean(axis=0, keepdims=True))


def halves(segment: Array) -> list[Array]:
    """Return the halves of a segment; the segment itself if it is one node."""
    if len(segment) == 1:
        return [segment]
    between = segment.mean(axis=0)
    return [np.stack([segment[0], between]), np.stack([between, segment[1]])]
