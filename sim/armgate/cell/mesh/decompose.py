"""Cuts a surface into convex bodies that together contain it and all that it encloses.

Space is cut into boxes, and each part is the hull of what of the mesh is in its box: that the parts contain
everything is so by construction (``cells``), wherever the cuts are. Where they are (``propose``) decides only
how closely the parts follow the mesh. Parts that can be one without getting larger are put together again:
the hull of two contains both.

Parts with too many corners are thinned and thickened by what that loses:
hull ⊂ thinned hull ⊕ loss, ⊕ meaning "thickened by". The slack of polygons that are
not quite flat and ``ROUNDING``, for floating-point rounding, are added.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armgate.cell.errors import ModelError
from armgate.cell.mesh.cells import Array, Surface
from armgate.cell.mesh.files import Mesh
from armgate.cell.mesh.hull import thinned
from armgate.cell.mesh.propose import propose, volume
from armgate.cell.shapes import Convex, is_solid

ROUNDING = 1e-9
"""What every part is thickened by, m: cutting and planes are right to far less."""

_FREE = 1e-3
"""Parts are put together if that adds no more than this share of their volume."""

_THICKER = 4e-6


@dataclass(frozen=True)
class Cut:
    """How to cut.

    Attributes:
        method: ``hull``: one part, the convex hull; ``parts``: as many as it takes.
        threshold: How much larger than the mesh the parts may be together, as a share of its volume.
        max_parts: At most so many parts.
        max_vertices: At most so many corners a part.
    """

    method: str
    threshold: float
    max_parts: int
    max_vertices: int


def cut(mesh: Mesh, how: Cut) -> tuple[Convex, ...]:
    """Convex bodies that together contain a mesh with all that it encloses.

    Raises:
        ModelError: The surface is not closed (``parts`` only).
    """
    check_closed(mesh, how)
    if how.method == "hull":
        return (_body(mesh.vertices, mesh.slack, how),)
    pieces = _together(_pieces(mesh, how))
    return tuple(_body(points, mesh.slack, how) for points in pieces)


def check_closed(mesh: Mesh, how: Cut) -> None:
    """Raise a ModelError if the surface must be closed for this cut, and is not."""
    if how.method != "hull" and mesh.open_edges:
        raise ModelError(
            f"the surface is not closed: {mesh.open_edges} edges belong to an odd number of triangles, so it "
            f"encloses nothing; mend the mesh, or take its convex hull (method: hull)"
        )


def _body(points: Array, slack: float, how: Cut) -> Convex:
    thin, loss = thinned(_solid(points), how.max_vertices)
    x = thin.vertices.tolist()
    return Convex(tuple((a, b, c) for a, b, c in x), loss + slack + ROUNDING)


def _solid(points: Array) -> Array:
    """Points with the same ones moved a little to either side, if they are flat: hulls have an inside."""
    if is_solid(points):
        return points
    middle = points - points.mean(axis=0)
    _, axes = np.linalg.eigh(middle.T @ middle)
    step = _THICKER + 1e-5 * float(np.ptp(points, axis=0).max())
    return np.concatenate([points + sign * step * axis for axis in axes.T for sign in (-1.0, 1.0)])


def _pieces(mesh: Mesh, how: Cut) -> list[Array]:
    """Points of each part: what of the mesh is in each cell of the proposed cuts."""
    surface = Surface(mesh.triangles)
    cells = [surface.whole()]
    for plane in propose(mesh, how.threshold, how.max_parts):
        cells[plane.leaf : plane.leaf + 1] = surface.cut(cells[plane.leaf], plane.axis, plane.at)
    return [np.unique(cell.points, axis=0) for cell in cells if len(cell.points)]


def _together(pieces: Sequence[Array]) -> list[Array]:
    """Joins two pieces, the cheapest first, as long as that costs nothing to speak of."""
    left = list(pieces)
    sizes = [volume(p) for p in left]
    cost: dict[tuple[int, int], float] = {}
    alive = list(range(len(left)))
    while True:
        for n, i in enumerate(alive):
            for j in alive[n + 1 :]:
                if (i, j) not in cost:
                    both = volume(np.concatenate([left[i], left[j]]))
                    cost[i, j] = (both - sizes[i] - sizes[j]) / max(both, 1e-300)
        open_pairs = {pair: c for pair, c in cost.items() if c <= _FREE}
        if not open_pairs:
            return [left[i] for i in alive]
        i, j = min(open_pairs, key=lambda pair: (open_pairs[pair], pair))
        left.append(np.unique(np.concatenate([left[i], left[j]]), axis=0))
        sizes.append(volume(left[-1]))
        alive = [k for k in alive if k not in (i, j)] + [len(left) - 1]
        cost = {pair: c for pair, c in cost.items() if i not in pair and j not in pair}
