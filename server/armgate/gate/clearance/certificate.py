"""Certificate of a pair: a direction that an engine suggested, and the lower bound that its slab proves.

Only lb = −h_B(−n) − h_A(n) is trusted. If it differs from coal's distance by more than ``GAP``, python-fcl is
queried too, and the larger bound is used; ``gaps`` is the number of such differences.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from armgate.cell.cell import Cell
from armgate.events import Point
from armgate.gate.clearance.engines import TOUCHING, CoalEngine, Engine, FclEngine
from armgate.gate.clearance.pair_groups import ChainGroup, Group
from armgate.gate.clearance.penetration import best_candidate_direction, rotated_direction
from armgate.gate.clearance.support import Cornered, Rows, support_of_one
from armgate.gate.clearance.swept import Array, Swept

GAP = 1e-4
"""Difference between bound and engine distance above which the second engine is queried, m."""

TIGHT = 5e-6
"""Largest difference between the bound and the distance of kept witness points without an engine query, m."""

_GAIN = 1e-9
"""Smallest increase of the bound for which another direction replaces the engine's, m; above rounding."""


@dataclass(slots=True)
class Budget:
    """Number of engine evaluations left; a pair that needs more of them counts as too near."""

    left: int

    def take(self) -> bool:
        """Take one evaluation; return False if the budget is used up."""
        self.left -= 1
        return self.left >= 0


@dataclass(frozen=True, slots=True)
class Certificate:
    """Direction (mine to theirs), the bound that it proves at one node of each side, and witness points."""

    n: Array
    lb: float
    points: tuple[Point, Point]


class Certifier:
    """Prover of lower bounds, with directions that the engines suggest.

    Attributes:
        first: The engine that is queried first.
        queries: Number of proven bounds.
        gaps: Number of bounds that differ from the distance of the first engine by more than ``GAP``.
    """

    def __init__(self, cell: Cell) -> None:
        shapes = tuple(b.shape for b in cell.bodies)
        self.first = CoalEngine(shapes)
        self._second: Engine = FclEngine(shapes)
        self.queries = 0
        self.gaps = 0

    def prove(self, group: Group, k: int, mine: Swept, theirs: Swept, at: tuple[int, int]) -> Certificate:
        """Prove a lower bound for the group's k-th pair with the two sides at the nodes ``at``.

        For a group of one chain ``theirs`` is the same as ``mine``.
        """
        self.queries += 1
        a, b = _posed(group, k, mine, theirs, at)
        n, lb, points = self._best(a, b)
        return Certificate(n @ a.R if isinstance(group, ChainGroup) else n, lb, points)

    def recall(
        self, group: Group, k: int, mine: Swept, theirs: Swept, witnesses: Sequence[Array]
    ) -> Certificate | None:
        """Return the bound along the line between two points, without a query; None if it is not tight.

        ``witnesses`` are a point of each body, in the frame of the body. The other arguments are those of
        `prove`, with both sides at their first nodes.
        """
        a, b = _posed(group, k, mine, theirs, (0, 0))
        p, q = a.R @ witnesses[0] + a.t, b.R @ witnesses[1] + b.t
        distance = float(np.linalg.norm(q - p))
        if not distance > TOUCHING:
            return None
        n = (q - p) / distance
        lb = _slab(a, b, n)
        if not (lb >= 0.0 and abs(distance - lb) <= TIGHT):
            return None
        return Certificate(n @ a.R if isinstance(group, ChainGroup) else n, lb, (point(p), point(q)))

    def _best(self, a: "_Posed", b: "_Posed") -> tuple[Array, float, tuple[Point, Point]]:
        suggestion = self.first.suggest(a.shape, (a.R, a.t), b.shape, (b.R, b.t))
        lb = _slab(a, b, suggestion.normal)
        if (
            abs(suggestion.distance - lb) > GAP
        ):  # a distance below lb: coal ended early, as it may for overlapping bodies
            self.gaps += 1
            other = self._second.suggest(a.shape, (a.R, a.t), b.shape, (b.R, b.t))
            second = _slab(a, b, other.normal)
            if second > lb:
                suggestion, lb = other, second
        n = suggestion.normal
        if lb < 0.0:
            n, lb = _overlap(a, b, n, lb, suggestion.distance)
        p, q = suggestion.points
        return n, lb, (point(p), point(q))


class _Posed(NamedTuple):
    """A body at a pose: its index in the cell, support parameters, R and t (world)."""

    shape: int
    row: Rows
    R: Array
    t: Array


def _posed(group: Group, k: int, mine: Swept, theirs: Swept, at: tuple[int, int]) -> tuple[_Posed, _Posed]:
    """Return both bodies of a pair, with the two sides at the nodes ``at``."""
    return (
        _Posed(int(group.shape_mine[k]), group.rows_mine[k], *mine.pose(at[0], int(group.mine[k]))),
        _Posed(int(group.shape_theirs[k]), group.rows_theirs[k], *theirs.pose(at[1], int(group.theirs[k]))),
    )


def _overlap(a: _Posed, b: _Posed, n: Array, lb: float, claimed: float) -> tuple[Array, float]:
    """Return a better direction for overlapping bodies and its bound, or else the given ones."""
    one, two = (a.row, a.R, a.t), (b.row, b.R, b.t)
    better, found = best_candidate_direction(one, two, n)
    if claimed - max(found, lb) > GAP or _has_corners(a) or _has_corners(b):
        better, found = rotated_direction(one, two, n)
    return (better, found) if found > lb + _GAIN else (n, lb)


def _has_corners(x: _Posed) -> bool:
    """Return True if a body has corners: its best direction need not be an axis."""
    return isinstance(x.row, Cornered) and bool(x.row.body >= 0)


def _slab(a: _Posed, b: _Posed, n: Array) -> float:
    """Return the slab n·(t_b − t_a) − h_a(n) − h_b(−n), each body in its own frame."""
    return float(n @ (b.t - a.t)) - support_of_one(a.row, n @ a.R) - support_of_one(b.row, -n @ b.R)


def point(x: Array) -> Point:
    """Return a vector, (3,), as a tuple."""
    a, b, c = x.tolist()
    return a, b, c
