"""How the camera of a robot sees: its frame looks along z, its x points up in the picture."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armgate.cell.placement import Placement

Array = NDArray[np.float64]

NEAR, FAR = 0.13, 60.0
"""Nothing nearer (the camera's own housing) or farther is seen, m."""


@dataclass(frozen=True)
class CameraModel:
    """A pinhole camera.

    Attributes:
        width: Of the picture, pixels.
        height: Of the picture, pixels.
        fov: Angle of view from left to right, rad.
    """

    width: int = 480
    height: int = 360
    fov: float = float(np.radians(50.0))

    @property
    def fov_vertical(self) -> float:
        """Angle of view from top to bottom, rad."""
        return 2.0 * float(np.arctan(np.tan(self.fov / 2) * self.height / self.width))

    @property
    def aspect(self) -> float:
        """Width of the picture over its height."""
        return self.width / self.height

    def view(self, camera: Placement) -> Array:
        """World to eye coordinates (x right, y up, −z ahead), (4, 4)."""
        x, y, z = camera.R.T
        eye = np.eye(4)
        eye[:3, :3] = np.stack([y, x, -z])
        eye[:3, 3] = -eye[:3, :3] @ camera.t
        return eye

    def projection(self) -> Array:
        """Eye to clip coordinates, OpenGL's, (4, 4)."""
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

    def pixel(self, camera: Placement, point: Array) -> tuple[float, float]:
        """Where a point of the world is in the picture: columns from the left, rows from the top."""
        clip = self.projection() @ self.view(camera) @ np.append(point, 1.0)
        x, y = clip[:2] / clip[3]
        return self.width * (1 + x) / 2, self.height * (1 - y) / 2


def drawn_frustum(camera: Placement) -> Placement:
    """The camera's frame as graphics has it: z ahead, x right, y down."""
    x, y, z = camera.R.T
    return Placement(np.stack([y, -x, z], axis=1), camera.t)
