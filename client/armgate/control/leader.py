"""Leader as the camera law needs it: the point to aim at, and the bounding spheres that repel."""

from __future__ import annotations

from armgate.cell.model import RobotModel
from armgate.control.repulsion import Obstacles
from armgate.control.spheres import Spheres
from armgate.control.weights import Vector


class Leader:
    """Robot whose tool a camera is aimed at.

    Args:
        model: its model.
        tool: name of its tool's frame.
        floor: height of the floor, which also repels, m; None without a floor.

    Raises:
        ModelError: for an unknown frame.
    """

    def __init__(self, model: RobotModel, tool: str, floor: float | None) -> None:
        model.frame_joint(tool)
        self._model = model
        self._tool = tool
        self._floor = floor
        self._spheres = Spheres.of(model)

    def at(self, q: Vector | None) -> tuple[Vector | None, Obstacles]:
        """Return the position of the tool (3,), world, m, and the obstacles, at q, (n,), rad or m.

        While q is unknown (None), there is no tool, and the only obstacle is the floor.
        """
        return (None, Obstacles(floor=self._floor)) if q is None else self._at(q)

    def _at(self, q: Vector) -> tuple[Vector, Obstacles]:
        tool = self._model.frame(q, self._tool).t
        return tool, Obstacles(self._spheres.centres(q), self._spheres.radii, self._floor)
