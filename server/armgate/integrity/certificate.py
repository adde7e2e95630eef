"""A pair's direction, found by an engine and judged by the slab it proves.

Only lb = −h_B(−n) − h_A(n) is believed. Where it falls short of what coal claims by more than ``GAP``,
python-fcl is asked too and the better proof counts; such gaps are counted.
"""

from dataclasses import dataclass

import numpy as np

from armgate.cell.cell import Cell
from armgate.cell.events import Point
from armgate.integrity.engine import CoalEngine, Engine, FclEngine, Suggestion
from armgate.integrity.groups import ChainGroup, Group
from armgate.integrity.swept import Array, Swept

GAP = 1e-4
"""A proof this much below the engine's claim asks for a second opinion, m."""


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
        said = self._ask(self._first, group, k, mine, theirs, at)
        best = _proof(group, k, mine, theirs, at, said)
        if said.distance - best.lb > GAP:
            self.gaps += 1
            other = self._ask(self._second, group, k, mine, theirs, at)
            second = _proof(group, k, mine, theirs, at, other)
            best = second if second.lb > best.lb else best
        return best

    def _ask(
        self, engine: Engine, group: Group, k: int, mine: Swept, theirs: Swept, at: tuple[int, int]
    ) -> Suggestion:
        other = mine if isinstance(group, ChainGroup) else theirs
        pose_a = mine.pose(at[0], int(group.mine[k]))
        pose_b = other.pose(at[1], int(group.theirs[k]))
        return engine.suggest(int(group.shape_mine[k]), pose_a, int(group.shape_theirs[k]), pose_b)


def _proof(group: Group, k: int, mine: Swept, theirs: Swept, at: tuple[int, int], said: Suggestion) -> Proof:
    n = said.normal
    if isinstance(group, ChainGroup):
        n = mine.pose(at[0], int(group.mine[k]))[0].T @ n
    lb, _, _ = group.slab(_still(mine, at[0]), _still(theirs, at[1]), np.array([k]), n[None, :])
    p, q = said.points
    return Proof(n, float(lb[0]), (_point(p), _point(q)))


def _still(side: Swept, node: int) -> Swept:
    """The side standing at one node."""
    nodes = side.nodes[node : node + 1]
    return Swept(
        side.R[node : node + 1], side.t[node : node + 1], np.zeros_like(side.stray), side.deltas[:0],
        np.zeros_like(side.tube), nodes,
    )  # fmt: skip


def _point(x: Array) -> Point:
    return float(x[0]), float(x[1]), float(x[2])
