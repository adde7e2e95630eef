"""Pairs of one robot, grouped by the other side: another robot, static bodies, or the robot itself.

The two sides of a pair move independently in time, so for one direction each is bounded separately. Only two
bodies of one chain move together: their pair is described in the frame of the nearer body, where only the
joints between them move.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from armgate.cell.cell import Body, Cell, Pair
from armgate.gate.clearance.support import Rows, support
from armgate.gate.clearance.swept import Array, Index, Space, Swept, chord_deviation


@dataclass(frozen=True, slots=True)
class Group:
    """P pairs of one robot with one other side.

    Attributes:
        other: Index of the other robot (the robot itself for bodies on different branches), None for static
            bodies.
        ids: Indices into the cell's pairs, (P,).
        mine: The robot's bodies, indices into its model's bodies, (P,).
        theirs: The other side's bodies: indices into its model's bodies, or into the cell's for static
            bodies, (P,).
        sign: +1 if ``mine`` is the pair's first body, else −1, (P,).
        limit: Distance to keep, m, (P,).
        shape_mine, shape_theirs: The bodies' indices in the cell, (P,).
        rows_mine, rows_theirs: Their support parameters, P.
        growth: Largest decrease of the distance per unit of each joint of the robot, (P, n).
    """

    other: int | None
    ids: Index
    mine: Index
    theirs: Index
    sign: Array
    limit: Array
    shape_mine: Index
    shape_theirs: Index
    rows_mine: Rows
    rows_theirs: Rows
    growth: Array

    def slab(self, mine: Swept, theirs: Swept, sel: Index, n: Array) -> tuple[Array, Index, Index]:
        """Return lower bounds of the distance for all timings of both sides, (P',), and the nodes that bind.

        lb = −max n·x over mine − max (−n)·x over theirs. The compiled form is ``kernels._apart``.

        Args:
            mine: Occupancy of the robot.
            theirs: Occupancy of the other side.
            sel: Selection of the group's pairs, (P',).
            n: Directions from mine to theirs, world frame, (P', 3).
        """
        near, node = mine.reach(self.rows_mine[sel], self.mine[sel], n)
        far, other = theirs.reach(self.rows_theirs[sel], self.theirs[sel], -n)
        return -near - far, node, other


@dataclass(frozen=True, slots=True)
class ChainGroup(Group):
    """Pairs of two bodies of one chain; ``mine`` is the body nearer to the base; directions use its frame.

    ``growth`` and ``bend`` (P, n, n) count only the joints between the two bodies.
    """

    bend: Array

    def slab(self, mine: Swept, theirs: Swept, sel: Index, n: Array) -> tuple[Array, Index, Index]:
        """Return lower bounds and binding nodes for two bodies at one time.

        Directions use the nearer body's frame; ``theirs`` is not used. The compiled form is
        ``kernels._chained``.
        """
        del theirs
        base_R, base_t = mine.R[:, self.mine[sel]], mine.t[:, self.mine[sel]]
        tip_R, tip_t = mine.R[:, self.theirs[sel]], mine.t[:, self.theirs[sel]]
        world = np.einsum("mpij,pj->mpi", base_R, n)
        local = np.einsum("mpji,mpj->mpi", tip_R, -world)
        along = support(self.rows_theirs[sel], local) - np.einsum("mpj,mpj->mp", tip_t - base_t, world)
        node = np.argmax(along, axis=0)
        lb = -support(self.rows_mine[sel], n) - along.max(axis=0) - self._deviation(mine, sel)
        return lb, node, node

    def _deviation(self, mine: Swept, sel: Index) -> Array:
        return np.asarray(self.growth[sel] @ mine.tube + chord_deviation(mine.deltas, self.bend[sel]))


def pair_groups_of(space: Space, robot: int) -> tuple[Group, ...]:
    """Return the groups of all pairs of a robot; the group of its chain first, if there is one."""
    by_side: dict[tuple[bool, int | None], list[tuple[int, Body, Body, float]]] = {}
    for k, pair in enumerate(space.cell.pairs):
        side = _side_of(space.cell, pair, robot)
        if side is not None:
            by_side.setdefault(side[:2], []).append((k, *side[2:]))
    sides = sorted(by_side.items(), key=lambda side: not side[0][0])
    return tuple(_build(space, robot, other, members, chained) for (chained, other), members in sides)


def _side_of(cell: Cell, pair: Pair, robot: int) -> tuple[bool, int | None, Body, Body, float] | None:
    a, b = cell.bodies[pair.a], cell.bodies[pair.b]
    if robot not in (a.robot, b.robot):
        return None
    if a.robot == b.robot and _moves(cell, a):
        chain = cell.robots[robot].model.chain
        return bool(np.all(chain[a.index] <= chain[b.index])), robot, a, b, 1.0
    mine, theirs, sign = (a, b, 1.0) if a.robot == robot and _moves(cell, a) else (b, a, -1.0)
    if mine.robot != robot or not _moves(cell, mine):
        return None
    return False, theirs.robot if _moves(cell, theirs) else None, mine, theirs, sign


def _moves(cell: Cell, body: Body) -> bool:
    return body.robot is not None and cell.robots[body.robot].model.bodies[body.index].joint >= 0


def _build(
    space: Space, robot: int, other: int | None, members: list[tuple[int, Body, Body, float]], chained: bool
) -> Group:
    cell = space.cell
    ids = np.array([m[0] for m in members], dtype=np.intp)
    mine = np.array([m[1].index for m in members], dtype=np.intp)
    at = {id(b): k for k, b in enumerate(cell.bodies)}
    shape_mine = np.array([at[id(m[1])] for m in members], dtype=np.intp)
    shape_theirs = np.array([at[id(m[2])] for m in members], dtype=np.intp)
    theirs = shape_theirs if other is None else np.array([m[2].index for m in members], dtype=np.intp)
    common = (
        other, ids, mine, theirs,
        np.array([m[3] for m in members]),
        np.array([cell.pairs[k].limit for k in ids]),
        shape_mine, shape_theirs, space.rows[shape_mine], space.rows[shape_theirs],
    )  # fmt: skip
    if not chained:
        return Group(*common, _growth(space, robot, other, mine, theirs))
    return ChainGroup(*common, *_between(space, robot, mine, theirs))


def with_present_bounds(space: Space, robot: int, groups: Sequence[Group]) -> tuple[Group, ...]:
    """Return a robot's groups with its present motion bounds."""
    return tuple(_with_present_bounds(space, robot, group) for group in groups)


def _with_present_bounds(space: Space, robot: int, group: Group) -> Group:
    if isinstance(group, ChainGroup):
        growth, bend = _between(space, robot, group.mine, group.theirs)
        return replace(group, growth=growth, bend=bend)
    return replace(group, growth=_growth(space, robot, group.other, group.mine, group.theirs))


def _growth(space: Space, robot: int, other: int | None, mine: Index, theirs: Index) -> Array:
    """Return R of the robot's bodies, (P, n); the sum of both if the robot is the other side too."""
    motion = space.motion[robot][mine]
    return motion + space.motion[robot][theirs] if other == robot else motion


def _between(space: Space, robot: int, mine: Index, theirs: Index) -> tuple[Array, Array]:
    """Return R (P, n) and G (P, n, n) of the outer bodies, for the joints between a pair's bodies only."""
    chain = space.cell.robots[robot].model.chain
    between = (chain[theirs] & ~chain[mine]).astype(np.float64)
    bend = space.bend[robot][theirs] * between[:, :, None] * between[:, None, :]
    return space.motion[robot][theirs] * between, bend
