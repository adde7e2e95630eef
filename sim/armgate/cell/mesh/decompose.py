"""Cuts a surface into convex bodies that together contain it.

CoACD cuts along planes; its parts are only a proposal. What they leave out of the surface is measured
exactly (``cover``) and given to the nearest part, which grows to the hull of itself and the piece; the hull
of a part and of points within d of it lies within d of the part, so this adds less than thickening would.
Parts with too many corners are thinned. What is missing then, of both causes, becomes the parts' rounding
radius.
With ⊕ for "thickened by",

    surface ⊂ (∪ hulls) ⊕ shortfall,  hull ⊂ thinned hull ⊕ loss,
    hence  surface ⊂ ∪ (thinned hull ⊕ (loss + shortfall)).

What is proven to be contained is the surface: nothing gets into the body without crossing it. That the
inside is filled too is looked at with sample points, once, when the mesh is cut.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armgate.cell.errors import ModelError
from armgate.cell.mesh.cover import gaps
from armgate.cell.mesh.files import Mesh
from armgate.cell.mesh.hull import Array, Hull, hull_of, thinned
from armgate.cell.shapes import Convex, is_solid

GROW = 1e-7
"""Pieces that stand out of all parts by more than this are given to a part, m; less goes to the radius."""

_REACH = 5e-5
"""CoACD's parts miss the surface by about a tenth of this share of its size, wherever it was cut."""

_ROUNDS = 4
_SEED = 20
_SAMPLES = 512


@dataclass(frozen=True)
class Cut:
    """How to cut.

    Attributes:
        method: ``hull``: one part, the convex hull; ``decompose``: as many as it takes.
        threshold: How much concavity a part may have before it is cut (CoACD's, a share of the mesh's size).
        max_parts: At most so many parts.
        max_vertices: At most so many corners a part.
    """

    method: str
    threshold: float
    max_parts: int
    max_vertices: int


def cut(mesh: Mesh, how: Cut) -> tuple[Hull, ...]:
    """Convex hulls that contain the surface of a mesh but for ``GROW``, corners not yet thinned.

    Raises:
        ModelError: It encloses no volume (``decompose`` only), or the parts leave out some of the inside.
    """
    if how.method == "hull":
        return (hull_of(mesh.vertices),)
    if mesh.open_edges:
        raise ModelError(
            f"the surface is not closed: {mesh.open_edges} edges do not join exactly two triangles; "
            f"mend the mesh, or take its convex hull (method: hull)"
        )
    hulls = [hull_of(points) for points in _proposed(mesh, how) if is_solid(points)]
    if not hulls:
        raise ModelError("no part of it is thick enough; take its convex hull (method: hull)")
    grown = _grown(mesh.triangles, hulls)
    _check_inside(mesh, grown)
    return tuple(grown)


def bodies(hulls: Sequence[Hull], missing: float, max_vertices: int) -> tuple[Convex, ...]:
    """The hulls as bodies, thinned, and thickened by what that loses and by what was missing before, m."""
    thin = [thinned(hull, max_vertices) for hull in hulls]
    return tuple(_body(hull, loss + missing) for hull, loss in thin)


def _body(hull: Hull, radius: float) -> Convex:
    return Convex(tuple((x, y, z) for x, y, z in hull.vertices.tolist()), radius)


def _proposed(mesh: Mesh, how: Cut) -> list[Array]:
    """The corners of CoACD's parts."""
    import coacd  # noqa: PLC0415  (most cells have no meshes)

    coacd.set_log_level("off")
    parts = coacd.run_coacd(
        coacd.Mesh(mesh.vertices, mesh.faces),
        threshold=how.threshold,
        max_convex_hull=how.max_parts,
        seed=_SEED,
    )
    return [np.array(vertices, dtype=np.float64) for vertices, _ in parts]


def _grown(triangles: Array, hulls: list[Hull]) -> list[Hull]:
    """The hulls, each with the pieces that no hull contains and that are nearest to it."""
    reach = _REACH * float(np.ptp(triangles, axis=(0, 1)).max())
    for _ in range(_ROUNDS):
        missing = [gap for gap in gaps(triangles, hulls, reach) if gap.distance > GROW]
        if not missing:
            break
        added: dict[int, list[Array]] = {}
        for gap in missing:
            added.setdefault(gap.hull, []).append(gap.polygon)
        hulls = [
            hull_of(np.concatenate([hull.vertices, *added[i]])) if i in added else hull
            for i, hull in enumerate(hulls)
        ]
    return hulls


# --- the inside ------------------------------------------------------------------------------------------


def _check_inside(mesh: Mesh, hulls: Sequence[Hull]) -> None:
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    points = np.random.default_rng(_SEED).uniform(low, high, (_SAMPLES, 3))
    inside = points[np.abs(_winding(mesh.triangles, points)) > 0.5]
    lost = [point for point in inside if min(float(hull.height(point[None])[0]) for hull in hulls) > GROW]
    if lost:
        place = ", ".join(f"{x:.4g}" for x in lost[0])
        raise ModelError(
            f"its parts leave out some of its inside, near ({place}); take its convex hull (method: hull)"
        )


def _winding(triangles: Array, points: Array) -> Array:
    """How often the surface goes around each point, (k,): solid angles (van Oosterom, Strackee 1983)."""
    turns = np.zeros(len(points))
    for i, point in enumerate(points):
        a, b, c = np.moveaxis(triangles - point, 1, 0)
        la, lb, lc = (np.linalg.norm(side, axis=1) for side in (a, b, c))
        volume = np.einsum("fi,fi->f", a, np.cross(b, c))
        dots = [np.einsum("fi,fi->f", p, q) for p, q in ((a, b), (b, c), (c, a))]
        below = la * lb * lc + dots[0] * lc + dots[1] * la + dots[2] * lb
        turns[i] = np.arctan2(volume, below).sum() / (2 * np.pi)
    return turns
