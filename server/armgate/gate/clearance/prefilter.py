"""Prefilter: the first two stages of clearance for all pairs of a robot at once.

Few pairs are left open by the kept bounds, but they belong to many groups: with each other robot, with
static bodies, with the robot itself. The held occupancies of all robots are in one table by body, so that one
pass of array operations treats all open pairs together. Only pairs of one chain, whose bodies move together,
need another formula.

A bound that is not a number proves nothing: comparisons are written so that its pair stays open.

`armgate.gate.clearance.compiled` has the compiled form.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from armgate.gate.clearance.pair_groups import ChainGroup, Group
from armgate.gate.clearance.support import support
from armgate.gate.clearance.swept import Array, Index, Space, Swept

MARGIN = 1e-9
"""Allowance for floating-point rounding, by which every bound is lowered, m."""

_AHEAD = 8.0
"""Number of further steps of the same size: pairs that would be open after them are tried together with the
open ones. The cost of a pass hardly depends on its number of pairs, so fewer passes are faster."""


@dataclass(frozen=True, slots=True)
class RobotPairs:
    """All pairs of one robot, group after group.

    Attributes:
        ids: Indices into the cell's pairs, (P,).
        mine, theirs: The two bodies' indices in the cell, (P,).
        sign: +1 if ``mine`` is the pair's first body, else −1, (P,).
        growth: Largest decrease of the distance per unit of each joint of the robot, (P, n).
        side: Index of each pair's group, (P,).
        chain: The group of pairs whose bodies move together, None if there is none.
        chained: Number of these pairs; they come first.
    """

    ids: Index
    mine: Index
    theirs: Index
    sign: Array
    growth: Array
    side: Index
    chain: ChainGroup | None
    chained: int


def robot_pairs(groups: Sequence[Group], n: int) -> RobotPairs:
    """Join the groups of a robot with ``n`` joints."""
    none = np.zeros(0, np.intp)
    chain = groups[0] if groups and isinstance(groups[0], ChainGroup) else None
    return RobotPairs(
        ids=_joined([g.ids for g in groups], none),
        mine=_joined([g.shape_mine for g in groups], none),
        theirs=_joined([g.shape_theirs for g in groups], none),
        sign=_joined([g.sign for g in groups], np.zeros(0)),
        growth=_joined([g.growth for g in groups], np.zeros((0, n))),
        side=_joined([np.full(len(g.ids), i, np.intp) for i, g in enumerate(groups)], none),
        chain=chain,
        chained=0 if chain is None else len(chain.ids),
    )


class Prefilter:
    """Numpy prefilter: lowers a robot's kept bounds, and tries the kept directions of pairs with low bounds.

    Args:
        space: The cell's bodies.
        pairs: The pairs of each robot.
    """

    def __init__(self, space: Space, pairs: Sequence[RobotPairs]) -> None:
        self.pairs = list(pairs)
        self._table = _Table(space)

    def replace(self, robot: int, own: RobotPairs) -> None:
        """Replace the motion bounds of a robot's pairs."""
        self.pairs[robot] = own

    def hold(self, robot: int, swept: Sequence[Swept]) -> None:
        """Store the held occupancies of a robot."""
        self._table.hold(robot, swept)

    def run(
        self, robot: int, new: Swept, step: Array | None, need: Array, kept: tuple[Array, Array]
    ) -> tuple[Array, Index]:
        """Check a new occupancy as far as that is possible without a distance engine.

        Args:
            robot: Index of the robot.
            new: The occupancy to check.
            step: Distance by which it extends the held one per joint; None if the kept bounds do not apply to
                it.
            need: The distance that each of the robot's P pairs must keep, m, (P,).
            kept: The kept bounds of the robot's pairs, m, (P,), and the directions of all pairs of the cell,
                first body to second, (…, 3).

        Returns:
            Lower bounds of the robot's pairs, (P,), and the places of those still open, ascending.
        """
        (bound, n), own = kept, self.pairs[robot]
        lb, left = self._lowered(robot, step, need, bound)
        if not len(left):
            return lb, left
        tried = left if step is None else self._with_next(own, step, need - lb, left)
        directions = n.take(own.ids[tried], axis=0) * own.sign[tried, None]
        lb[tried] = np.fmax(lb[tried], self._slabs(robot, new, tried, directions) - MARGIN)
        return lb, left[~(lb[left] >= need[left])]

    def _lowered(self, robot: int, step: Array | None, need: Array, bound: Array) -> tuple[Array, Index]:
        """Return the kept bounds less the growth, and the places of those that do not suffice, ascending.

        The compiled form is ``kernels.lower``.
        """
        own = self.pairs[robot]
        lb = np.full(len(own.ids), -np.inf) if step is None else bound - own.growth @ step
        return lb, (~(lb >= need)).nonzero()[0]

    def _with_next(self, own: RobotPairs, step: Array, short: Array, left: Index) -> Index:
        """Return the open pairs, and pairs in their groups that will be open soon, ascending."""
        soon = (short > -_AHEAD * (own.growth @ step)).nonzero()[0]
        needed = np.zeros(len(own.side), dtype=np.bool_)
        needed[own.side[left]] = True
        return np.asarray(soon[needed[own.side[soon]]])

    def _slabs(self, robot: int, new: Swept, left: Index, n: Array) -> Array:
        """Return the swept slabs of the pairs ``left``, ascending, with directions mine to theirs.

        The compiled form is ``kernels.slabs``.
        """
        own, lb = self.pairs[robot], np.empty(len(left))
        first = int(left.searchsorted(own.chained))
        if own.chain is not None and first:
            lb[:first] = own.chain.slab(new, new, left[:first], n[:first])[0]
        if first < len(left):
            apart = left[first:]
            lb[first:] = self._table.slabs(robot, new, own.mine[apart], own.theirs[apart], n[first:])
        return lb


class _Table:
    """Poses of every body at the nodes of its robot's held occupancies, by its index in the cell.

    The last node of a robot is repeated if the table has more rows. The deviation of a robot of unknown
    position is ∞: its pairs stay open.
    """

    def __init__(self, space: Space) -> None:
        self._held: list[Sequence[Swept]] = [() for _ in space.cell.robots]
        self._stale: set[int] = set()
        self._rows = space.rows
        owner = [-1 if b.robot is None else b.robot for b in space.cell.bodies]
        self._owner = np.array(owner, dtype=np.intp)
        ends = np.cumsum([len(r.model.bodies) for r in space.cell.robots]).tolist()
        self._own = [slice(*reach) for reach in pairwise([0, *ends])]
        self._R, self._t = space.static.R.copy(), space.static.t.copy()
        self._deviation = np.zeros(self._t.shape[:2])
        for mine in self._own:
            self._deviation[:, mine] = np.inf

    def hold(self, robot: int, swept: Sequence[Swept]) -> None:
        """Store the held occupancies of a robot; they are written at the next query that needs them."""
        self._held[robot] = swept
        self._stale.add(robot)

    def slabs(self, robot: int, new: Swept, mine: Index, theirs: Index, n: Array) -> Array:
        """Return lower bounds, (P,), for pairs of independent sides, with ``robot`` in ``new``."""
        owner = self._owner[theirs]
        for other in [k for k in self._stale if k != robot and (owner == k).any()]:
            self._write(other, self._held[other])
            self._stale.discard(other)
        self._write(robot, [new])
        self._stale.add(robot)
        reach = self._reach(np.concatenate([mine, theirs]), np.concatenate([n, -n]))
        return np.asarray(-reach[: len(mine)] - reach[len(mine) :])

    def _reach(self, bodies: Index, n: Array) -> Array:
        """Return the largest n·x over all positions that each body may pass, (P,).

        The compiled form is ``kernels._reach``.
        """
        local = np.einsum("mpji,pj->mpi", self._R.take(bodies, axis=1), n)
        along = support(self._rows[bodies], local) + self._deviation.take(bodies, axis=1)
        along += np.einsum("mpj,pj->mp", self._t.take(bodies, axis=1), n)
        return np.asarray(along.max(axis=0))

    def _write(self, robot: int, swept: Sequence[Swept]) -> None:
        """Write the occupancies of a robot to its rows. The compiled form is ``kernels.hold``."""
        mine, row = self._own[robot], 0
        self._make_room(sum(len(s.nodes) for s in swept))
        for s in swept:
            rows = slice(row, row + len(s.nodes))
            self._R[rows, mine], self._t[rows, mine], self._deviation[rows, mine] = s.R, s.t, s.deviation
            row = rows.stop
        if 0 < row < len(self._t):
            for values in (self._R, self._t, self._deviation):
                values[row:, mine] = values[row - 1, mine]

    def _make_room(self, rows: int) -> None:
        missing = rows - len(self._t)
        if missing > 0:
            self._R, self._t, self._deviation = (
                _extended(x, missing) for x in (self._R, self._t, self._deviation)
            )


def _extended(values: Array, rows: int) -> Array:
    return np.concatenate([values, np.repeat(values[-1:], rows, axis=0)])


def _joined(parts: list[Any], empty: Any) -> Any:
    return np.concatenate(parts) if parts else empty
