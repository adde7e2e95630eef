"""Picture of a robot's camera: drawn in a thread of its own, shown in a corner of the page."""

import threading
from typing import Any

import numpy as np

from armgate.apps.errors import AppError
from armgate.apps.view.camera_model import CameraModel
from armgate.apps.view.frame_timer import FrameTimer
from armgate.apps.view.overlays import q_of
from armgate.apps.view.render import Picture
from armgate.apps.view.render_process import RenderProcess
from armgate.apps.view.scene import Poses, Scene, SceneRobot
from armgate.apps.view.source import Source
from armgate.client import State

RATE = 15.0
"""Largest rate of pictures, 1/s."""
WIDTH = 330
"""Width of the picture on the page, CSS pixels."""


class CameraPicture:
    """Picture of a camera.

    Attributes:
        problem: Reason why there is no picture, in words; None while there is one.
        picture: Newest picture (height, width, 3).
        drawn: Number of pictures drawn.
    """

    def __init__(
        self, gui: Any, scene: Scene, source: Source, robot: SceneRobot, camera_model: CameraModel
    ) -> None:
        self.problem: str | None = None
        self.picture: Picture | None = None
        self.drawn = 0
        self._scene, self._source, self._robot, self._camera_model = scene, source, robot, camera_model
        self._ended = threading.Event()
        panel = gui.add_panel()
        panel.float(x=12, y=-12, width=WIDTH)
        with panel.add_tab(f"Camera of {robot.name}", icon="camera"):
            empty = np.full((camera_model.height, camera_model.width, 3), 225, dtype=np.uint8)
            self._image = gui.add_image(empty, format="jpeg", jpeg_quality=80)
            self._text = gui.add_markdown("", visible=False)
        self._thread = threading.Thread(target=self._run, name="camera", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread."""
        self._ended.set()
        self._thread.join()

    def _run(self) -> None:
        try:
            renderer = RenderProcess(self._scene, self._camera_model)
        except AppError as error:
            self._show_problem(str(error))
            return
        try:
            self._draw_all(renderer)
        except AppError as error:
            self._show_problem(str(error))
        finally:
            renderer.close()

    def _draw_all(self, renderer: RenderProcess) -> None:
        poses, seen, timer = Poses(self._scene), None, FrameTimer(RATE)
        while not self._ended.is_set():
            state = self._source.newest()
            if state is not None and state is not seen:
                seen = state
                self._draw(renderer, poses, state)
            self._ended.wait(timer.remaining())

    def _draw(self, renderer: RenderProcess, poses: Poses, state: State) -> None:
        camera = self._robot.described.camera
        places = {robot.name: q_of(state, robot.name) for robot in self._scene.robots}
        if camera is None or any(q is None for q in places.values()):
            return
        links = {name: poses.links(name, q) for name, q in places.items()}
        lens = poses.models[self._robot.name].frame(places[self._robot.name], camera)
        self.picture = renderer.picture(lens, links)
        self.drawn += 1
        self._image.image = self.picture

    def _show_problem(self, problem: str) -> None:
        self.problem = problem
        self._image.visible = False
        self._text.content = problem
        self._text.visible = True
