"""Pinhole model of a robot's camera: its frame has z along the view, and x upwards in the picture."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armgate.cell.placement import Placement

Array = NDArray[np.float64]

NEAR, FAR = 0.13, 60.0
"""Distances of the clipping planes, m; the near one hides the camera's own housing."""


@dataclass(frozen=True)
class CameraModel:
    """Pinhole camera.

    Attributes:
        width: Width of the picture, pixels.
        height: Height of the picture, pixels.
        fov: Horizontal angle of view, rad.
    """

    width: int = 480
    height: int = 360
    fov: float = float(np.radians(50.0))

    @property
    def fov_vertical(self) -> float:
        """Vertical angle of view, rad."""
        return 2.0 * float(np.arctan(np.tan(self.fov / 2) * self.height / self.width))

    @property
    def aspect(self) -> float:
        """Width of the picture over its height."""
        return self.width / self.height

    def view(self, camera: Placement) -> Array:
        """Return the transformation from world to eye coordinates (x right, y up, −z ahead), (4, 4)."""
        x, y, z = camera.R.T
        eye = np.eye(4)
        eye[:3, :3] = np.stack([y, x, -z])
        eye[:3, 3] = -eye[:3, :3] @ camera.t
        return eye

    def projection(self) -> Array:
        """Return the transformation from eye to clip coordinates of OpenGL, (4, 4)."""
        fx = 1.0 / np.tan(self.fov / 2)
        fy = fx * self.width / self.height
        depth = FAR - NEAR
        return np.array(
            [
                [fx, 0, 0, 0],
                [0, fy, 0, 0],
                [0, 0, -(FAR + NEAR) / depth, -2 * FAR * NEAR / depth],
                [0, 0, -1, 0],
            ]
        )


def drawn_frustum(camera: Placement) -> Placement:
    """Return the camera's frame in the convention of computer graphics: z ahead, x right, y down."""
    x, y, z = camera.R.T
    return Placement(np.stack([y, -x, z], axis=1), camera.t)
