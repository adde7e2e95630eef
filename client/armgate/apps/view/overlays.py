"""Overlays of the scene: clearances, stop paths, the camera's view and manipulability."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from armgate.apps.view import colours
from armgate.apps.view.camera_model import CameraModel, drawn_frustum
from armgate.apps.view.scene import Poses, Scene
from armgate.apps.view.scene_nodes import LinkNodes, wxyz
from armgate.apps.view.shapes import mesh_of
from armgate.cell.placement import Placement
from armgate.client import Entry, State
from armgate.control.redundancy.ellipsoids import velocity_ellipsoid

LINES = 6
"""Number of the smallest clearances that are drawn."""
GHOST: colours.RGB = (120, 60, 200)
ELLIPSOID: colours.RGB = (60, 130, 220)
_POINT = 3
"""Length of a signal that is a point."""
SPEED = 0.12
"""Length of a semi-axis per m/s of tool speed at joint speeds of norm 1, m."""
THIN = 0.004
"""Smallest semi-axis that is drawn, m: the ellipsoid is flat at a singularity."""
GHOST_FROM = 0.03
"""Smallest stop distance at which a stop path is drawn, rad or m; shorter ones would only tint the robot."""


class Overlays:
    """All overlays; each can be shown or hidden.

    Attributes:
        shown: True for each overlay that is shown, by name.
    """

    def __init__(self, page: Any, scene: Scene, camera_model: CameraModel) -> None:
        self.shown = dict.fromkeys(("clearances", "stop paths", "camera", "manipulability"), True)
        self._scene = scene
        self._lines = page.add_line_segments(
            "/overlays/clearances", np.zeros((1, 2, 3)), colors=np.zeros((1, 2, 3), np.uint8),
            thickness=3.0, thickness_units="screen", visible=False,
        )  # fmt: skip
        self._ghosts = {
            robot.name: LinkNodes(page, f"/overlays/stop/{robot.name}", robot.pieces, GHOST)
            for robot in scene.robots
        }
        ball = mesh_of("sphere", (1.0,))
        self._focus = page.add_mesh_simple(
            "/overlays/focus", 0.03 * ball.vertices, ball.faces, color=colours.STATES["clear"], opacity=0.55,
            cast_shadow=False, visible=False,
        )  # fmt: skip
        self._frustum = page.add_camera_frustum(
            "/overlays/camera", camera_model.fov_vertical, camera_model.aspect, scale=0.25,
            color=(30, 70, 150), thickness=2.0, thickness_units="screen", visible=False,
        )  # fmt: skip
        self._ellipsoids = {
            robot.name: page.add_mesh_simple(
                f"/overlays/manipulability/{robot.name}", ball.vertices, ball.faces, color=ELLIPSOID,
                opacity=0.3, cast_shadow=False, receive_shadow=False, visible=False,
            )
            for robot in scene.robots
        }  # fmt: skip

    def update(self, state: State, poses: Poses) -> None:
        """Draw the overlays for a state."""
        self._draw_clearances(state.entries)
        for entry in state.entries:
            if entry.q is not None:
                self._draw_stop(entry, poses)
                self._draw_ellipsoid(entry, poses)
        self._draw_camera(state, poses)

    def _draw_clearances(self, entries: tuple[Entry, ...]) -> None:
        lines = nearest_lines(entries)[:LINES] if self.shown["clearances"] else []
        self._lines.visible = bool(lines)
        if lines:
            points = np.array([line[0] for line in lines], dtype=np.float32)
            colours = np.repeat(np.array([line[1] for line in lines], dtype=np.uint8)[:, None], 2, axis=1)
            self._lines.points = points
            self._lines.colors = colours

    def _draw_stop(self, entry: Entry, poses: Poses) -> None:
        ghost = self._ghosts[entry.robot]
        moves = moves_visibly(entry)
        ghost.show(moves and self.shown["stop paths"])
        if moves and self.shown["stop paths"] and entry.stop_end is not None:
            ghost.move(poses.links(entry.robot, entry.stop_end))

    def _draw_ellipsoid(self, entry: Entry, poses: Poses) -> None:
        node, shown = self._ellipsoids[entry.robot], self.shown["manipulability"]
        node.visible = shown
        if not shown:
            return
        robot = next(robot for robot in self._scene.robots if robot.name == entry.robot)
        place, lengths = ellipsoid(poses, entry, robot.described.tool)
        node.position, node.wxyz, node.scale = place.t, wxyz(place), lengths

    def _draw_camera(self, state: State, poses: Poses) -> None:
        robot, shown = self._scene.camera_robot, self.shown["camera"]
        focus = state.signals.get("follow.focus")
        known = focus is not None and len(focus.value) == _POINT
        self._focus.visible = shown and known
        if focus is not None and known:
            self._focus.position = focus.value
        q = None if robot is None else q_of(state, robot.name)
        self._frustum.visible = shown and q is not None
        if robot is not None and q is not None and robot.described.camera is not None:
            camera = drawn_frustum(poses.models[robot.name].frame(q, robot.described.camera))
            self._frustum.position, self._frustum.wxyz = camera.t, wxyz(camera)


def nearest_lines(entries: tuple[Entry, ...]) -> list[tuple[Any, colours.RGB]]:
    """Return witness points (2, 3) and colour of the nearest pairs, each once, the smallest margin first."""
    found: dict[tuple[str, str], tuple[float, Any, colours.RGB]] = {}
    for entry in entries:
        for near in entry.nearest or ():
            if near.points is not None:
                margin = near.distance - near.limit
                pair = (min(near.pair), max(near.pair))
                if pair not in found or margin < found[pair][0]:
                    found[pair] = (margin, near.points, colours.margin(near.distance, near.limit))
    return [(points, colour) for _, points, colour in sorted(found.values(), key=lambda line: line[0])]


def moves_visibly(entry: Entry) -> bool:
    """Return True if the robot would still move visibly if it were stopped now."""
    if entry.q is None or entry.stop_end is None:
        return False
    return bool(np.abs(np.subtract(entry.stop_end, entry.q)).max() > GHOST_FROM)


def ellipsoid(poses: Poses, entry: Entry, tool: str) -> tuple[Placement, tuple[float, float, float]]:
    """Return the pose and the semi-axes, m, of the velocity ellipsoid of the tool's origin."""
    model = poses.models[entry.robot]
    at = model.frame(np.array(entry.q), tool).t
    found = velocity_ellipsoid(model.frame_jacobian(np.array(entry.q), tool)[:3])
    axes = found.axes * np.array([1.0, 1.0, np.sign(np.linalg.det(found.axes))])
    x, y, z = (max(SPEED * float(length), THIN) for length in found.lengths)
    return Placement(axes, at), (x, y, z)


def q_of(state: State, robot: str) -> Any:
    """Return the measured position of a robot; None if the state does not contain it."""
    q: Mapping[str, Any] = {entry.robot: entry.q for entry in state.entries}
    found = q.get(robot)
    return None if found is None else np.array(found)
