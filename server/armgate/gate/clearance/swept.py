"""Swept space of an occupancy: placements of the bodies at the nodes, and their deviation between the nodes.

Between two nodes q and q + δ each point x of a body deviates from its chord by at most K/8 with
K = Σ_ij |δ_i||δ_j|·G_ij, G_ij bounding |∂²x/∂q_i∂q_j|; the tube e adds Σ_j R_j·e_j, R_j bounding |∂x/∂q_j|.
So for a fixed direction n and *every* position in the occupancy

    n·x ≤ max over the nodes of n·x + K/8 + Σ_j R_j e_j.

R and G hold for every q if all prismatic joints are nearer to the base than the revolute ones. A prismatic
joint behind a revolute one changes the length of a lever: for such robots R and G hold for a
`MotionBoundsRange`, and are computed anew for a robot that is found outside of it.
"""

from collections.abc import Callable, Sequence
from functools import cached_property, partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armgate.cell.cell import Cell
from armgate.cell.motion_bounds import bend_bounds, motion_bounds
from armgate.events import Joints
from armgate.gate.clearance.motion_bounds_range import MotionBoundsRange
from armgate.gate.clearance.support import Rows, support, support_table
from armgate.gate.occupancy import Occupancy

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Place = Callable[[int, ArrayLike], tuple[Array, Array]]
"""Function that returns the placements of a robot's bodies at q, R (nb, 3, 3) and t (nb, 3)."""

_KEPT = 8


class Swept:
    """A robot's bodies over an occupancy with m nodes. Arrays and placements are made at the first access.

    Args:
        nodes: Joint positions, (m, n).
        tube: e, (n,).
        place: Function that returns the placements at the nodes, R (m, nb, 3, 3) and t (m, nb, 3).
        motion: R_j of each body, (nb, n).
        bend: G_ij of each body, (nb, n, n).

    Attributes:
        motion: R_j of each body, (nb, n).
        bend: G_ij of each body, (nb, n, n).
    """

    def __init__(
        self,
        nodes: ArrayLike,
        tube: ArrayLike,
        place: Callable[[], tuple[Array, Array]],
        motion: Array,
        bend: Array,
    ) -> None:
        self._over = nodes, tube
        self._place = place
        self.motion = motion
        self.bend = bend

    @cached_property
    def nodes(self) -> Array:
        """Joint positions, (m, n)."""
        return np.asarray(self._over[0])

    @cached_property
    def tube(self) -> Array:
        """The tube e, (n,)."""
        return np.asarray(self._over[1])

    @cached_property
    def placements(self) -> tuple[Array, Array]:
        """Placements at the nodes, R (m, nb, 3, 3) and t (m, nb, 3)."""
        return self._place()

    @property
    def R(self) -> Array:
        """Rotations, (m, nb, 3, 3)."""
        return self.placements[0]

    @property
    def t(self) -> Array:
        """Positions, (m, nb, 3)."""
        return self.placements[1]

    @cached_property
    def deltas(self) -> Array:
        """|δ| of the segments between the nodes, (m − 1, n)."""
        return np.abs(np.diff(self.nodes, axis=0))

    @cached_property
    def deviation(self) -> Array:
        """Largest distance of each body's points from their chords, K/8 + Σ_j R_j e_j, (nb,).

        The compiled form is in ``kernels._sweep``.
        """
        return np.asarray(self.motion @ self.tube + chord_deviation(self.deltas, self.bend))

    def pose(self, node: int, body: int) -> tuple[Array, Array]:
        """Return (R, t) of one body at one node."""
        return self.R[node, body], self.t[node, body]

    def reach(self, rows: Rows, bodies: Index, n: Array) -> tuple[Array, Index]:
        """Return max n·x over the occupancy for P bodies and directions n (P, 3), and the binding node.

        The compiled form is ``kernels._reach``.
        """
        local = np.einsum("mpji,pj->mpi", self.R[:, bodies], n)
        along = support(rows, local) + np.einsum("mpj,pj->mp", self.t[:, bodies], n)
        node = np.argmax(along, axis=0)
        return along.max(axis=0) + self.deviation[bodies], node


def chord_deviation(deltas: Array, bend: Array) -> Array:
    """Return K/8, the largest over the segments, for P bodies or pairs with bend bounds (P, n, n), (P,).

    The compiled form is ``kernels._chord_deviation``.

    Args:
        deltas: |δ| of the segments, (s, n).
        bend: G_ij, (P, n, n).
    """
    if not len(deltas):
        return np.zeros(len(bend))
    return np.asarray(np.einsum("si,bij,sj->sb", deltas, bend, deltas).max(axis=0) / 8.0)


class Space:
    """Bodies of the cell as numbers: support parameters, motion bounds, and sweeps of occupancies.

    Attributes:
        ranges: Joint positions of each robot for which its motion bounds hold.
    """

    def __init__(self, cell: Cell) -> None:
        self.cell = cell
        self.rows = support_table([b.shape for b in cell.bodies])
        self.ranges = [MotionBoundsRange.of(r) for r in cell.robots]
        self.motion = [motion_bounds(r.model, *x.ends) for r, x in zip(cell.robots, self.ranges, strict=True)]
        self.bend = [bend_bounds(r.model, *x.ends) for r, x in zip(cell.robots, self.ranges, strict=True)]
        self.static = self._static()
        self._place: Place = self._place_by_model
        self._known: list[dict[Joints, tuple[Array, Array]]] = [{} for _ in cell.robots]

    def fit(self, robot: int, nodes: Sequence[Joints], margin: float) -> bool:
        """Compute a robot's motion bounds anew if it may be outside their range; return True if so.

        Args:
            robot: Its index.
            nodes: Positions that it may have.
            margin: Largest distance from them in every joint, rad or m.
        """
        fitted = self.ranges[robot].fitted(nodes, margin)
        if fitted is self.ranges[robot]:
            return False
        model = self.cell.robots[robot].model
        self.ranges[robot] = fitted
        self.motion[robot], self.bend[robot] = (f(model, *fitted.ends) for f in (motion_bounds, bend_bounds))
        return True

    def place_with(self, place: Place) -> None:
        """Use another implementation of the same kinematics."""
        self._place = place

    def sweep(self, robot: int, occupied: Occupancy) -> Swept:
        """Return a robot's bodies over an occupancy."""
        place = partial(self._placed_at, robot, occupied.nodes)
        return Swept(occupied.nodes, occupied.tube, place, self.motion[robot], self.bend[robot])

    def sweep_nodes(self, robot: int, nodes: Array, tube: Array) -> Swept:
        """Return a robot's bodies over nodes (m, n) with a tube (n,), without keeping the placements."""
        place = partial(self._place_at, robot, nodes)
        return Swept(nodes, tube, place, self.motion[robot], self.bend[robot])

    def still(self, robot: int, q: Joints) -> Swept:
        """Return a robot's bodies at ``q``, at rest."""
        return self.sweep(robot, Occupancy((q,), (0.0,) * len(q)))

    # Placements are bound methods, not closures, so that a gate can be pickled (`armgate.world.saving`).

    def _place_by_model(self, robot: int, q: ArrayLike) -> tuple[Array, Array]:
        return self.cell.robots[robot].model.body_placements(q)

    def _place_at(self, robot: int, nodes: Array) -> tuple[Array, Array]:
        return _stacked([self._place(robot, q) for q in nodes])

    def _placed_at(self, robot: int, nodes: Sequence[Joints]) -> tuple[Array, Array]:
        return _stacked([self._placed(robot, q) for q in nodes])

    def _placed(self, robot: int, q: Joints) -> tuple[Array, Array]:
        """Return placements at ``q``; the last few are kept, as successive occupancies share most nodes."""
        known = self._known[robot]
        placed = known.pop(q, None)
        if placed is None:
            placed = self._place(robot, q)
        known[q] = placed
        if len(known) > _KEPT:
            del known[next(iter(known))]
        return placed

    def _static(self) -> Swept:
        """Return all static bodies by their index in the cell (the others are at the origin, unused)."""
        count = len(self.cell.bodies)
        R, t = np.tile(np.eye(3), (1, count, 1, 1)), np.zeros((1, count, 3))
        for k, body in enumerate(self.cell.bodies):
            if body.robot is None or self.cell.robots[body.robot].model.bodies[body.index].joint < 0:
                R[0, k], t[0, k] = body.placement.R, body.placement.t
        none = np.zeros((count, 0))
        return Swept(np.zeros((1, 0)), np.zeros(0), partial(_pair, R, t), none, none[:, :, None])


def _pair(R: Array, t: Array) -> tuple[Array, Array]:
    return R, t


def _stacked(placed: list[tuple[Array, Array]]) -> tuple[Array, Array]:
    return np.array([R for R, _ in placed]), np.array([t for _, t in placed])
