"""Initial viewpoint of a page: the side from which the surroundings hide the fewest robot bodies."""

import numpy as np
from numpy.typing import NDArray

from armgate.apps.view.scene import Poses, Scene
from armgate.cell.placement import Placement
from armgate.client import Body, Description

Array = NDArray[np.float64]
Point = tuple[float, float, float]

SIDES = 36
"""Number of directions that are tried."""
RISE = 0.38
"""Height of the eye above the centre, as a share of the distance."""


def initial_viewpoint(scene: Scene) -> tuple[Point, Point]:
    """Return the position of the eye and the point it looks at, m."""
    poses = Poses(scene)
    places = _places(scene.description, poses, scene)
    points = np.array([place.t for body, place in places if body.robot is not None])
    bases = np.array([robot.described.base_xyz for robot in scene.robots])
    tools = np.array(
        [poses.models[r.name].frame(r.described.start, r.described.tool).t for r in scene.robots]
    )
    middle = np.concatenate([bases, tools]).mean(axis=0)
    distance = 1.6 * float(np.ptp(np.concatenate([bases, tools]), axis=0).max()) + 1.2
    walls = [(_half(body), place) for body, place in places if body.shape.kind == "box"]
    # If several sides are equal, the view from the front left is used, as is usual.
    turns = np.radians(-65.0) + np.linspace(0.0, 2 * np.pi, SIDES, endpoint=False)
    eyes = [middle + distance * np.array([np.cos(u), np.sin(u), RISE]) for u in turns]
    hidden = [
        _hidden(eye, points, walls) + 0.4 * (1.0 - np.cos(u - turns[0]))
        for u, eye in zip(turns, eyes, strict=True)
    ]
    return _point(eyes[int(np.argmin(hidden))]), _point(middle)


def _places(description: Description, poses: Poses, scene: Scene) -> list[tuple[Body, Placement]]:
    start = {robot.name: robot.described.start for robot in scene.robots}
    found = []
    for body in description.bodies:
        own = Placement.from_quaternion(body.xyz, body.xyzw)
        if body.robot is not None and body.link is not None:
            own = poses.models[body.robot].frame(start[body.robot], body.link) @ own
        found.append((body, own))
    return found


def _half(body: Body) -> Array:
    return np.array(body.shape.size) / 2


def _hidden(eye: Array, points: Array, walls: list[tuple[Array, Placement]]) -> int:
    """Return the number of points that are hidden behind a box which does not contain them."""
    return sum(any(_between(eye, point, half, place) for half, place in walls) for point in points)


def _between(eye: Array, point: Array, half: Array, place: Placement) -> bool:
    """Return True if the line from eye to point enters a box and leaves it again."""
    start = place.R.T @ (eye - place.t)
    way = place.R.T @ (point - place.t) - start
    way = np.where(np.abs(way) < 1e-12, 1e-12, way)
    a, b = (-half - start) / way, (half - start) / way
    enter, leave = np.minimum(a, b).max(), np.maximum(a, b).min()
    return bool(0.0 < enter < leave < 1.0)


def _point(values: Array) -> Point:
    x, y, z = values.tolist()
    return x, y, z
