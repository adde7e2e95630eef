"""What an occupancy means in space: every body's placements at the nodes, and how far it strays between them.

Between two nodes q and q + δ each point x of a body strays from its chord by at most K/8 with
K = Σ_ij |δ_i||δ_j|·G_ij, G_ij bounding |∂²x/∂q_i∂q_j|; the tube e adds Σ_j R_j·e_j, R_j bounding |∂x/∂q_j|.
So for a fixed direction n and *every* position in the occupancy

    n·x ≤ max over the nodes of n·x + K/8 + Σ_j R_j e_j.

R and G hold for every q if all prismatic joints are nearer to the base than the revolute ones. A prismatic
joint behind a revolute one is a lever whose length changes: there they hold for a `Range`, and are computed
anew for a robot that is found outside of it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armgate.cell.cell import Cell
from armgate.cell.motion import bend_bounds, motion_bounds
from armgate.events import Joints
from armgate.gate.occupancy import Occupancy
from armgate.gate.range import Range
from armgate.gate.support import Rows, support, support_table

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Place = Callable[[int, ArrayLike], tuple[Array, Array]]
"""Gives the placements of a robot's bodies at q, R (nb, 3, 3) and t (nb, 3)."""

_KEPT = 8


@dataclass(frozen=True, eq=False)
class Swept:
    """A robot's bodies over an occupancy with m nodes; placed only when somebody looks.

    Attributes:
        nodes: Joint positions, (m, n).
        tube: e, (n,).
        place: Gives the bodies' placements at the nodes, R (m, nb, 3, 3) and t (m, nb, 3).
        motion: R_j of each body, (nb, n).
        bend: G_ij of each body, (nb, n, n).
    """

    nodes: Array
    tube: Array
    place: Callable[[], tuple[Array, Array]]
    motion: Array
    bend: Array

    @cached_property
    def placements(self) -> tuple[Array, Array]:
        """R (m, nb, 3, 3) and t (m, nb, 3)."""
        return self.place()

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
    def stray(self) -> Array:
        """How far each body strays from its chords, K/8 + Σ_j R_j e_j, (nb,)."""
        stray = self.motion @ self.tube
        if len(self.deltas):
            curl = np.einsum("si,bij,sj->sb", self.deltas, self.bend, self.deltas)
            stray = stray + curl.max(axis=0) / 8.0
        return np.asarray(stray)

    def pose(self, node: int, body: int) -> tuple[Array, Array]:
        """Returns (R, t) of one body at one node."""
        return self.R[node, body], self.t[node, body]

    def reach(self, rows: Rows, bodies: Index, n: Array) -> tuple[Array, Index]:
        """Returns max n·x over the occupancy for P bodies and directions n (P, 3), and the binding node."""
        local = np.einsum("mpji,pj->mpi", self.R[:, bodies], n)
        along = support(rows, local) + np.einsum("mpj,pj->mp", self.t[:, bodies], n)
        node = np.argmax(along, axis=0)
        return along.max(axis=0) + self.stray[bodies], node


class Space:
    """The cell's bodies as numbers: support parameters and motion bounds, and sweeps of occupancies.

    Attributes:
        ranges: The positions of each robot for which its motion bounds hold.
    """

    def __init__(self, cell: Cell) -> None:
        self.cell = cell
        self.rows = support_table([b.shape for b in cell.bodies])
        self.ranges = [Range.of(r) for r in cell.robots]
        self.motion = [motion_bounds(r.model, *x.ends) for r, x in zip(cell.robots, self.ranges, strict=True)]
        self.bend = [bend_bounds(r.model, *x.ends) for r, x in zip(cell.robots, self.ranges, strict=True)]
        self.static = self._static()
        self._place: Place = lambda robot, q: cell.robots[robot].model.body_placements(q)
        self._known: list[dict[Joints, tuple[Array, Array]]] = [{} for _ in cell.robots]

    def fit(self, robot: int, nodes: Sequence[Joints], room: float) -> bool:
        """Compute a robot's motion bounds anew if it may be outside of their range; True if that was needed.

        Args:
            robot: Its index.
            nodes: Positions that it may have.
            room: How far it may be from them, in every joint, rad or m.
        """
        fitted = self.ranges[robot].fitted(nodes, room)
        if fitted is self.ranges[robot]:
            return False
        model = self.cell.robots[robot].model
        self.ranges[robot] = fitted
        self.motion[robot], self.bend[robot] = (f(model, *fitted.ends) for f in (motion_bounds, bend_bounds))
        return True

    def place_with(self, place: Place) -> None:
        """Has bodies placed by another form of the same kinematics."""
        self._place = place

    def sweep(self, robot: int, occupied: Occupancy) -> Swept:
        """A robot's bodies over an occupancy."""

        def place() -> tuple[Array, Array]:
            return _stacked([self._placed(robot, q) for q in occupied.nodes])

        return self._swept(robot, np.array(occupied.nodes), np.array(occupied.tube), place)

    def sweep_nodes(self, robot: int, nodes: Array, tube: Array) -> Swept:
        """The same for nodes (m, n) and a tube (n,) that will not come again."""
        return self._swept(robot, nodes, tube, lambda: _stacked([self._place(robot, q) for q in nodes]))

    def still(self, robot: int, q: Joints) -> Swept:
        """A robot's bodies with the robot standing at ``q``."""
        return self.sweep(robot, Occupancy((q,), (0.0,) * len(q)))

    def _swept(
        self, robot: int, nodes: Array, tube: Array, place: Callable[[], tuple[Array, Array]]
    ) -> Swept:
        return Swept(nodes, tube, place, self.motion[robot], self.bend[robot])

    def _placed(self, robot: int, q: Joints) -> tuple[Array, Array]:
        """Placements at ``q``; the last few are kept, since one occupancy shares most nodes with the next."""
        known = self._known[robot]
        placed = known.pop(q, None)
        if placed is None:
            placed = self._place(robot, q)
        known[q] = placed
        if len(known) > _KEPT:
            del known[next(iter(known))]
        return placed

    def _static(self) -> Swept:
        """All bodies that never move, by their index in the cell (the others stand at the origin, unused)."""
        count = len(self.cell.bodies)
        R, t = np.tile(np.eye(3), (1, count, 1, 1)), np.zeros((1, count, 3))
        for k, body in enumerate(self.cell.bodies):
            if body.robot is None or self.cell.robots[body.robot].model.bodies[body.index].joint < 0:
                R[0, k], t[0, k] = body.placement.R, body.placement.t
        none = np.zeros((count, 0))
        return Swept(np.zeros((1, 0)), np.zeros(0), lambda: (R, t), none, none[:, :, None])


def _stacked(placed: list[tuple[Array, Array]]) -> tuple[Array, Array]:
    return np.array([R for R, _ in placed]), np.array([t for _, t in placed])
