"""Outlines of bodies in a plane, for pictures."""

import numpy as np
from numpy.typing import NDArray

from armgate.cell.cell import Body, Cell
from armgate.events import Joints
from armgate.gate import support, support_table

Array = NDArray[np.float64]

_ANGLES = np.linspace(0.0, 2.0 * np.pi, 73)[:-1]


def placed(cell: Cell, body: Body, q: Joints) -> tuple[Array, Array]:
    """Rotation (3, 3) and centre (3,) [m] of a body in the world, with its robot at q."""
    if body.robot is None:
        return np.asarray(body.placement.R), np.asarray(body.placement.t)
    R, t = cell.robots[body.robot].model.body_placements(q)
    return R[body.index], t[body.index]


def outline(body: Body, at: tuple[Array, Array], view: Array) -> Array:
    """What a body covers in a plane: corners (72, 2) [m] of a polygon around it.

    Every body is convex, so its outline is what its tangents enclose: p·d(φ) = h(d(φ)) for all angles φ, of
    which neighbours are intersected.

    Args:
        body: The body.
        at: Its rotation and centre in the world.
        view: The plane's two axes in the world, (2, 3).
    """
    R, t = at
    directions = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], axis=1)
    rows = support_table([body.shape])
    h = np.array([support(rows, (d @ view @ R)[None, :])[0] for d in directions])
    after = np.roll(directions, -1, axis=0)
    h_after = np.roll(h, -1)
    cross = directions[:, 0] * after[:, 1] - directions[:, 1] * after[:, 0]
    x = (h * after[:, 1] - h_after * directions[:, 1]) / cross
    y = (directions[:, 0] * h_after - after[:, 0] * h) / cross
    return np.asarray(np.stack([x, y], axis=1) + view @ t)


def view_along(a: Array, b: Array) -> Array:
    """Axes (2, 3) of an upright plane along ``a`` – ``b``: in it that line has its true length."""
    across = np.array([b[0] - a[0], b[1] - a[1], 0.0])
    length = float(np.linalg.norm(across))
    if length < 1e-3:
        across, length = np.array([1.0, 0.0, 0.0]), 1.0
    return np.stack([across / length, np.array([0.0, 0.0, 1.0])])
