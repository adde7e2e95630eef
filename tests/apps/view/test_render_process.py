"""Pictures from a render process."""

import os
import signal

import numpy as np
import pytest

from armgate.apps.errors import AppError
from armgate.apps.view.camera_model import CameraModel
from armgate.apps.view.render import Renderer
from armgate.apps.view.render_process import RenderProcess
from armgate.apps.view.scene import Poses

CAMERA = CameraModel(160, 120)


def test_the_process_draws_like_the_renderer_and_its_end_is_reported(scene):
    poses = Poses(scene)
    start = {robot.name: np.array(robot.described.start) for robot in scene.robots}
    links = {name: poses.links(name, q) for name, q in start.items()}
    camera = poses.models["FR"].frame(start["FR"], "camera")
    renderer, process = Renderer(scene, CAMERA), RenderProcess(scene, CAMERA)
    try:
        assert np.array_equal(process.picture(camera, links), renderer.picture(camera, links))
        os.kill(process._process.pid, signal.SIGKILL)
        with pytest.raises(AppError, match="the process that draws it has ended"):
            process.picture(camera, links)
    finally:
        process.close()
        renderer.close()


def test_missing_opengl_is_reported_with_the_packages(scene, monkeypatch):
    # The child inherits these variables: EGL finds no driver.
    monkeypatch.setenv("__EGL_VENDOR_LIBRARY_FILENAMES", "/nowhere.json")
    monkeypatch.setenv("__EGL_VENDOR_LIBRARY_DIRS", "/nowhere")
    with pytest.raises(AppError, match="apt-get install libegl1 libgl1-mesa-dri"):
        RenderProcess(scene, CAMERA)
