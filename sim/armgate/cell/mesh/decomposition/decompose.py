"""Decomposition of a surface into convex bodies that together contain it and everything that it encloses.

Space is cut into boxes, and each body is the hull of the part of the mesh in one box. The bodies contain
everything for any choice of cuts (proof in ``cutting``). The choice (``choose_planes``) affects only how
closely the bodies follow the mesh. Two pieces are merged if their common hull, which contains both, is hardly
larger than the two hulls.

Bodies with too many corners are thinned, and thickened by the loss: hull ⊂ thinned hull ⊕ loss, with ⊕
for "thickened by". The slack of polygons that are not quite flat, and ``ROUNDING`` for floating-point errors,
are added.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, assert_never

import numpy as np

from armgate.cell.errors import ModelError
from armgate.cell.mesh.decomposition.choose_planes import hull_volume, propose_planes
from armgate.cell.mesh.decomposition.cutting import Array, Surface
from armgate.cell.mesh.hull import thinned
from armgate.cell.mesh.triangle_mesh import TriangleMesh
from armgate.cell.shapes import Convex, is_solid

ROUNDING = 1e-9
"""Thickness added to every body, m; rounding errors of cuts and planes are far smaller."""

_FREE = 1e-3
"""Largest growth of the volume by which two pieces are still merged, as a share of it."""

_THICKENING = 4e-6
"""Half the thickness given to flat pieces, m."""


Method = Literal["parts", "hull"]


@dataclass(frozen=True)
class DecompositionOptions:
    """Options of the decomposition.

    Attributes:
        method: ``hull`` for one body, the convex hull; ``parts`` for as many bodies as needed.
        threshold: Excess volume of all bodies beyond that of the mesh, as a share of it, at which cutting
            ends.
        max_parts: Largest number of bodies.
        max_vertices: Largest number of corners of a body.
    """

    method: Method
    threshold: float
    max_parts: int
    max_vertices: int


def decompose(mesh: TriangleMesh, options: DecompositionOptions) -> tuple[Convex, ...]:
    """Return convex bodies that together contain a mesh and everything that it encloses.

    Raises:
        ModelError: The surface is not closed (``parts`` only).
    """
    check_closed(mesh, options)
    match options.method:
        case "hull":
            pieces = [mesh.vertices]
        case "parts":
            pieces = _merge(_pieces(mesh, options))
        case _:
            assert_never(options.method)
    return tuple(_body(points, mesh.slack, options) for points in pieces)


def check_closed(mesh: TriangleMesh, options: DecompositionOptions) -> None:
    """Raise a ModelError if the surface must be closed for this method, and is not."""
    if options.method != "hull" and mesh.open_edges:
        raise ModelError(
            f"the surface is not closed: {mesh.open_edges} edges belong to an odd number of triangles, so it "
            f"encloses nothing; repair the mesh, or take its convex hull (method: hull)"
        )


def _body(points: Array, slack: float, options: DecompositionOptions) -> Convex:
    thin, loss = thinned(_solid(points), options.max_vertices)
    x = thin.vertices.tolist()
    return Convex(tuple((a, b, c) for a, b, c in x), loss + slack + ROUNDING)


def _solid(points: Array) -> Array:
    """Return points; flat ones with copies shifted to both sides, so that their hull has an inside."""
    if is_solid(points):
        return points
    middle = points - points.mean(axis=0)
    _, axes = np.linalg.eigh(middle.T @ middle)
    step = _THICKENING + 1e-5 * float(np.ptp(points, axis=0).max())
    return np.concatenate([points + sign * step * axis for axis in axes.T for sign in (-1.0, 1.0)])


def _pieces(mesh: TriangleMesh, options: DecompositionOptions) -> list[Array]:
    """Return the points of each piece after all proposed cuts."""
    surface = Surface(mesh.triangles)
    pieces = [surface.whole()]
    for plane in propose_planes(mesh, options.threshold, options.max_parts):
        pieces[plane.piece : plane.piece + 1] = surface.cut(pieces[plane.piece], plane.axis, plane.at)
    return [np.unique(piece.points, axis=0) for piece in pieces if len(piece.points)]


def _merge(pieces: Sequence[Array]) -> list[Array]:
    """Merge pairs of pieces, the cheapest first, as long as their volume grows by at most ``_FREE``."""
    points = list(pieces)
    volumes = [hull_volume(piece) for piece in points]
    growth: dict[tuple[int, int], float] = {}
    alive = list(range(len(points)))
    while True:
        for n, i in enumerate(alive):
            for j in alive[n + 1 :]:
                if (i, j) not in growth:
                    both = hull_volume(np.concatenate([points[i], points[j]]))
                    growth[i, j] = (both - volumes[i] - volumes[j]) / max(both, 1e-300)
        mergeable = {pair: share for pair, share in growth.items() if share <= _FREE}
        if not mergeable:
            return [points[i] for i in alive]
        i, j = min(mergeable, key=lambda pair: (mergeable[pair], pair))
        points.append(np.unique(np.concatenate([points[i], points[j]]), axis=0))
        volumes.append(hull_volume(points[-1]))
        alive = [k for k in alive if k not in (i, j)] + [len(points) - 1]
        growth = {pair: share for pair, share in growth.items() if i not in pair and j not in pair}
