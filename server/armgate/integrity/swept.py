"""What an occupancy means in space: every body's placements at the nodes, and how far it strays between them.

Between two nodes q and q + δ each point x of a body strays from its chord by at most K/8 with
K = Σ_ij |δ_i||δ_j|·G_ij, G_ij bounding |∂²x/∂q_i∂q_j|; the tube e adds Σ_j R_j·e_j, R_j bounding |∂x/∂q_j|.
Both bounds hold for every q, so for a fixed direction n and *every* position in the occupancy

    n·x ≤ max over the nodes of n·x + K/8 + Σ_j R_j e_j.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armgate.cell.cell import Cell
from armgate.cell.events import Joints
from armgate.cell.motion import bend_bounds, motion_bounds
from armgate.integrity.occupancy import Occupancy
from armgate.integrity.support import support, support_table

Array = NDArray[np.float64]
Index = NDArray[np.intp]
_KEPT = 8


@dataclass(frozen=True, slots=True)
class Swept:
    """Bodies over an occupancy: R (m, nb, 3, 3), t (m, nb, 3) at the m nodes; stray (nb,) in m.

    ``deltas`` are the |δ| of the segments between the nodes, (m − 1, n); ``tube`` is e, (n,).
    """

    R: Array
    t: Array
    stray: Array
    deltas: Array
    tube: Array
    nodes: Array

    def pose(self, node: int, body: int) -> tuple[Array, Array]:
        """Returns (R, t) of one body at one node."""
        return self.R[node, body], self.t[node, body]

    def reach(self, rows: Array, bodies: Index, n: Array) -> tuple[Array, Index]:
        """Returns max n·x over the occupancy for P bodies and directions n (P, 3), and the binding node."""
        local = np.einsum("mpji,pj->mpi", self.R[:, bodies], n)
        along = support(rows, local) + np.einsum("mpj,pj->mp", self.t[:, bodies], n)
        node = np.argmax(along, axis=0)
        return along.max(axis=0) + self.stray[bodies], node


class Space:
    """The cell's bodies as numbers: support parameters and motion bounds, and sweeps of occupancies."""

    def __init__(self, cell: Cell) -> None:
        self.cell = cell
        self.rows = support_table([b.shape for b in cell.bodies])
        self.motion = [motion_bounds(r.model) for r in cell.robots]
        self.bend = [bend_bounds(r.model) for r in cell.robots]
        self.static = self._static()
        self._known: list[dict[Joints, tuple[Array, Array]]] = [{} for _ in cell.robots]

    def sweep(self, robot: int, occupied: Occupancy) -> Swept:
        """Places all bodies of a robot at the nodes of an occupancy."""
        placed = [self._placed(robot, q) for q in occupied.nodes]
        return self._swept(robot, placed, np.array(occupied.nodes), np.array(occupied.tube))

    def sweep_nodes(self, robot: int, nodes: Array, tube: Array) -> Swept:
        """The same for nodes (m, n) and a tube (n,) that will not come again."""
        model = self.cell.robots[robot].model
        return self._swept(robot, [model.body_placements(q) for q in nodes], nodes, tube)

    def still(self, robot: int, q: Joints) -> Swept:
        """Places all bodies of a robot that stands at ``q``."""
        nodes = np.array([q])
        return self._swept(robot, [self._placed(robot, q)], nodes, np.zeros(nodes.shape[1]))

    def _placed(self, robot: int, q: Joints) -> tuple[Array, Array]:
        """Placements at ``q``; the last few are kept, since one occupancy shares most nodes with the next."""
        known = self._known[robot]
        placed = known.pop(q, None)
        if placed is None:
            placed = self.cell.robots[robot].model.body_placements(q)
        known[q] = placed
        if len(known) > _KEPT:
            del known[next(iter(known))]
        return placed

    def _swept(self, robot: int, placed: list[tuple[Array, Array]], nodes: Array, tube: Array) -> Swept:
        deltas = np.abs(np.diff(nodes, axis=0))
        stray = self.motion[robot] @ tube
        if len(deltas):
            curl = np.einsum("si,bij,sj->sb", deltas, self.bend[robot], deltas)
            stray = stray + curl.max(axis=0) / 8.0
        R, t = (np.stack(x) for x in zip(*placed, strict=True))
        return Swept(R, t, stray, deltas, tube, nodes)

    def _static(self) -> Swept:
        """All bodies that never move, by their index in the cell (the others stand at the origin, unused)."""
        count = len(self.cell.bodies)
        R, t = np.tile(np.eye(3), (1, count, 1, 1)), np.zeros((1, count, 3))
        for k, body in enumerate(self.cell.bodies):
            if body.robot is None or self.cell.robots[body.robot].model.bodies[body.index].joint < 0:
                R[0, k], t[0, k] = body.placement.R, body.placement.t
        return Swept(R, t, np.zeros(count), np.zeros((0, 0)), np.zeros(0), np.zeros((1, 0)))
