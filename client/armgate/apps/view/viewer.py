"""Page of the viewer: built once for a cell, then drawn at 30 Hz from the newest state.

The page only displays positions, so opening or reloading it changes nothing in the cell. Only a page that
holds a robot's lease moves the robot.
"""

import threading
from dataclasses import dataclass
from itertools import count
from typing import Any

from armgate.apps.view import colours
from armgate.apps.view.buttons import Buttons
from armgate.apps.view.camera_model import CameraModel
from armgate.apps.view.camera_picture import CameraPicture
from armgate.apps.view.driving import Driving
from armgate.apps.view.frame_timer import FrameTimer
from armgate.apps.view.live import Live
from armgate.apps.view.overlays import Overlays
from armgate.apps.view.playback_controls import PlaybackControls
from armgate.apps.view.player import Player
from armgate.apps.view.plots import Plots
from armgate.apps.view.scene import Poses, Scene
from armgate.apps.view.scene_nodes import LinkNodes, draw_surroundings
from armgate.apps.view.source import Source
from armgate.apps.view.state_panel import StatePanel
from armgate.apps.view.viewpoint import initial_viewpoint
from armgate.client import State

RATE = 30.0
"""Frames of the scene per s."""
PANEL_EVERY, PLOT_EVERY = 3, 10
"""Frames between two updates of the panel, and of the plots."""


@dataclass(frozen=True)
class Style:
    """Options of the viewer.

    Attributes:
        speed: Largest share of the robots' speeds with which pages drive.
        meshes: True if known arms are drawn with their real meshes, provided that these are installed.
    """

    speed: float = 0.25
    meshes: bool = True


class Viewer:
    """Page of one source.

    Args:
        server: The server of viser.
        source: Source of the states.
        style: Options.

    Attributes:
        camera_picture: Picture of the camera; None if no robot has a camera.
    """

    def __init__(self, server: Any, source: Source, style: Style) -> None:
        self._server, self._source = server, source
        camera_model = CameraModel()
        self._scene = Scene.build(source.description, source.asset, meshes=style.meshes)
        self._poses = Poses(self._scene)
        self._configure()
        with server.atomic():
            draw_surroundings(server.scene, self._scene)
            self._robots = {
                robot.name: LinkNodes(server.scene, f"/robots/{robot.name}", robot.pieces)
                for robot in self._scene.robots
            }
            self._overlays = Overlays(server.scene, self._scene, camera_model)
        self._panel = StatePanel(server.gui, source.description)
        self._plots = Plots(server.gui)
        self._driving: Driving | None = None
        if isinstance(source, Live):
            buttons = Buttons(server.gui, source, self._notify)
            if source.drives:
                self._driving = Driving(server, source, style.speed)
                buttons.add_driving(self._driving)
        self._playback_controls = PlaybackControls(server.gui, source) if isinstance(source, Player) else None
        self._panel.add_overlays(self._overlays)
        robot = self._scene.camera_robot
        self.camera_picture = (
            None if robot is None else CameraPicture(server.gui, self._scene, source, robot, camera_model)
        )

    def __enter__(self) -> "Viewer":
        return self

    def __exit__(self, *_: object) -> None:
        if self._driving is not None:
            self._driving.close()
        if self.camera_picture is not None:
            self.camera_picture.close()

    def run(self, ended: threading.Event) -> None:
        """Draw until ``ended`` is set or the source reports a problem."""
        shown: State | None = None
        timer = FrameTimer(RATE)
        for turn in count():
            if ended.is_set():
                return
            state = self._source.newest()
            if state is not None and state is not shown:
                shown = state
                self._draw(state)
            if shown is not None:
                self._update_panel(shown, turn)
            if (problem := self._source.problem) is not None:
                self._panel.fail(problem)
                return
            ended.wait(timer.remaining())

    def _draw(self, state: State) -> None:
        with self._server.atomic():
            for entry in state.entries:
                if entry.q is not None:
                    self._robots[entry.robot].move(self._poses.links(entry.robot, entry.q))
            self._overlays.update(state, self._poses)
            if self._driving is not None:
                self._driving.update(state, self._poses)
        self._plots.take(state)

    def _update_panel(self, state: State, turn: int) -> None:
        """Update the panel and the plots at their lower rates, also while no state arrives."""
        if turn % PANEL_EVERY == 0:
            self._panel.update(state, self._source)
            if self._playback_controls is not None:
                self._playback_controls.show()
        if turn % PLOT_EVERY == 0:
            self._plots.draw()

    def _configure(self) -> None:
        gui = self._server.gui
        gui.configure_theme(
            control_layout="fixed", control_width="medium", show_logo=False, show_share_button=False,
            brand_color=colours.ARM,
        )  # fmt: skip
        gui.set_panel_label(f"armgate · {self._source.description.name}")
        eye, at = initial_viewpoint(self._scene)
        self._server.initial_camera.position = eye
        self._server.initial_camera.look_at = at

    def _notify(self, title: str, text: str, colour: str) -> None:
        for client in self._server.get_clients().values():
            client.add_notification(title, text, color=colour, auto_close_seconds=8.0)
