"""A pair's direction, found by an engine and judged by the slab it proves.

Only lb = −h_B(−n) − h_A(n) is believed. Where it differs from what coal claims by more than ``GAP``,
python-fcl is asked too and the better proof counts; such gaps are counted.
"""

from dataclasses import dataclass
from typing import NamedTuple

from armgate.cell.cell import Cell
from armgate.events import Point
from armgate.gate.engine import CoalEngine, Engine, FclEngine
from armgate.gate.groups import ChainGroup, Group
from armgate.gate.penetration import tried_direction, turned_direction
from armgate.gate.support import Cornered, Rows, support_of_one
from armgate.gate.swept import Array, Swept

GAP = 1e-4
"""A proof this much off the engine's claim asks for a second opinion, m."""


_GAIN = 1e-9
"""A direction of an overlap is replaced if another one proves more by this, m: more than rounding."""


@dataclass(slots=True)
class Budget:
    """How many engine evaluations one command may cost; used up, it refuses: never guess."""

    left: int

    def take(self) -> bool:
        """Takes one evaluation; False if none is left."""
        self.left -= 1
        return self.left >= 0


@dataclass(frozen=True, slots=True)
class Proof:
    """A direction (mine to theirs), the bound it proves at one node of each side, the engine's points."""

    n: Array
    lb: float
    points: tuple[Point, Point]


class Certifier:
    """Asks the engines and proves what they say."""

    def __init__(self, cell: Cell) -> None:
        shapes = tuple(b.shape for b in cell.bodies)
        self._first: Engine = CoalEngine(shapes)
        self._second: Engine = FclEngine(shapes)
        self.queries = 0
        self.gaps = 0

    def prove(self, group: Group, k: int, mine: Swept, theirs: Swept, at: tuple[int, int]) -> Proof:
        """Proves a lower bound for the group's k-th pair with both sides standing at the nodes ``at``."""
        self.queries += 1
        other = mine if isinstance(group, ChainGroup) else theirs
        a = _Posed(int(group.shape_mine[k]), group.rows_mine[k], *mine.pose(at[0], int(group.mine[k])))
        b = _Posed(int(group.shape_theirs[k]), group.rows_theirs[k], *other.pose(at[1], int(group.theirs[k])))
        n, lb, points = self._best(a, b)
        if isinstance(group, ChainGroup):
            n = n @ a.R
        return Proof(n, lb, points)

    def _best(self, a: "_Posed", b: "_Posed") -> tuple[Array, float, tuple[Point, Point]]:
        said = self._first.suggest(a.shape, (a.R, a.t), b.shape, (b.R, b.t))
        lb = _slab(a, b, said.normal)
        if abs(said.distance - lb) > GAP:  # below lb: coal gave up, as it may where bodies overlap
            self.gaps += 1
            other = self._second.suggest(a.shape, (a.R, a.t), b.shape, (b.R, b.t))
            second = _slab(a, b, other.normal)
            if second > lb:
                said, lb = other, second
        n = said.normal
        if lb < 0.0:
            n, lb = _deep(a, b, n, lb, said.distance)
        p, q = said.points
        return n, lb, (_point(p), _point(q))


class _Posed(NamedTuple):
    """A body at a place: its index in the cell, support parameters, R and t (world)."""

    shape: int
    row: Rows
    R: Array
    t: Array


def _deep(a: _Posed, b: _Posed, n: Array, lb: float, claimed: float) -> tuple[Array, float]:
    """Return a better direction of bodies that overlap, and what it proves; the given one if none is."""
    one, two = (a.row, a.R, a.t), (b.row, b.R, b.t)
    better, found = tried_direction(one, two, n)
    if claimed - max(found, lb) > GAP or _cornered(a) or _cornered(b):
        better, found = turned_direction(one, two, n)
    return (better, found) if found > lb + _GAIN else (n, lb)


def _cornered(x: _Posed) -> bool:
    """Return True if a body's faces stand at none of its axes."""
    return isinstance(x.row, Cornered) and bool(x.row.body >= 0)


def _slab(a: _Posed, b: _Posed, n: Array) -> float:
    """The slab n·(t_b − t_a) − h_a(n) − h_b(−n), each body in its own frame."""
    return float(n @ (b.t - a.t)) - support_of_one(a.row, n @ a.R) - support_of_one(b.row, -n @ b.R)


def _point(x: Array) -> Point:
    a, b, c = x.tolist()
    return a, b, c
