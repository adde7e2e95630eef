"""View errors of a camera: the two errors that the paper reports."""

from __future__ import annotations

from math import atan2

import numpy as np
from numpy.typing import ArrayLike

from armgate.cell.model import RobotModel
from armgate.control.weights import Vector


def view_errors(model: RobotModel, frame: str, q: Vector, p: ArrayLike, wanted: float) -> tuple[float, float]:
    """Return angle and distance error of the camera at `frame`.

    Args:
        model: robot that carries the camera.
        frame: frame of the camera: origin in the lens, z along the view.
        q: (n,), rad or m.
        p: the target, world, (3,), m.
        wanted: d_r, m.

    Returns:
        θ in [0, π], rad, between view axis and the ray to the target (0 with the target in the lens), and
        ‖p − x‖ − d_r, m.

    Raises:
        ModelError: for an unknown frame.
    """
    camera = model.frame(q, frame)
    y1, y2, y3 = camera.R.T @ (np.asarray(p, dtype=np.float64) - camera.t)
    across = float(np.hypot(y1, y2))
    return atan2(across, y3), float(np.hypot(across, y3)) - wanted
