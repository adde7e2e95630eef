"""Rendered pictures, checked by their pixels."""

import numpy as np
import pytest

from armgate.apps.errors import AppError
from armgate.apps.view import colours, render
from armgate.apps.view.camera_model import CameraModel, drawn_frustum
from armgate.apps.view.render import Renderer
from armgate.apps.view.scene import Poses
from armgate.cell.placement import Placement
from support.pictures import middle_of

UP = np.array([0.0, 0.0, 1.0])


def start(scene):
    return {robot.name: np.array(robot.described.start) for robot in scene.robots}


@pytest.fixture
def renderer(scene):
    made = Renderer(scene, CameraModel())
    yield made
    made.close()


def shot(scene, renderer, camera, q=None):
    poses = Poses(scene)
    return renderer.picture(camera, {name: poses.links(name, x) for name, x in (q or start(scene)).items()})


def pixel(model, camera, point):
    """Return the pixel of a world point: column from the left, row from the top."""
    clip = model.projection() @ model.view(camera) @ np.append(point, 1.0)
    x, y = clip[:2] / clip[3]
    return model.width * (1 + x) / 2, model.height * (1 - y) / 2


@pytest.mark.parametrize("aside", [(0.0, 0.0), (0.15, 0.1), (-0.2, 0.05)])
def test_a_point_is_drawn_at_the_pixel_of_the_camera_model(scene, renderer, aside):
    tool = Poses(scene).models["GR"].frame(start(scene)["GR"], "tool0")
    # From below the tool, which points down: nothing can hide its tip.
    z = np.array([aside[0], aside[1], 1.0])
    z /= np.linalg.norm(z)
    x = np.cross([0.0, 1.0, 0.0], z)
    x /= np.linalg.norm(x)
    camera = Placement(np.stack([x, np.cross(z, x), z], axis=1), tool.t - 0.8 * UP)
    tip = tool.t - 0.02 * UP
    picture = shot(scene, renderer, camera)
    assert picture.shape == (360, 480, 3)
    column, row = middle_of(picture, colours.TOOL)
    assert (column, row) == pytest.approx(pixel(renderer.camera_model, camera, tip), abs=3.0)


def test_the_picture_stands_upright_and_shows_the_cell(scene, renderer):
    camera = Poses(scene).models["FR"].frame(start(scene)["FR"], "camera")
    picture = shot(scene, renderer, camera).astype(int)
    sky, floor = picture[:60].mean(axis=(0, 1)), picture[-40:].mean(axis=(0, 1))
    assert sky.mean() > floor.mean() + 20  # light above, the floor below
    # GR is lifted: its hand moves up in the picture.
    q = start(scene)
    low = middle_of(shot(scene, renderer, camera, q), colours.HAND)
    q["GR"] = q["GR"] + np.eye(9)[2] * 0.15
    high = middle_of(shot(scene, renderer, camera, q), colours.HAND)
    assert high[1] < low[1] - 20
    assert high[0] == pytest.approx(low[0], abs=3)
    # GR moves to its left seen from FR (+y): left in the picture.
    q = start(scene)
    q["GR"] = q["GR"] + np.eye(9)[1] * 0.15
    assert middle_of(shot(scene, renderer, camera, q), colours.HAND)[0] < low[0] - 20


def test_the_frustum_uses_the_convention_of_computer_graphics():
    camera = Placement.from_rpy((1.0, 2.0, 3.0), (0.3, -0.2, 0.9))
    drawn = drawn_frustum(camera)
    assert drawn.R[:, 2] == pytest.approx(camera.R[:, 2])
    assert drawn.R[:, 1] == pytest.approx(-camera.R[:, 0])  # down is opposite to the camera's x
    assert np.linalg.det(drawn.R) == pytest.approx(1.0)


def test_without_egl_the_packages_are_named(scene, monkeypatch):
    import moderngl

    def broken(**_):
        raise ValueError("libEGL.so.1: cannot open shared object file")

    monkeypatch.setattr(moderngl, "create_context", broken)
    with pytest.raises(AppError, match=r"libEGL.*apt-get install libegl1 libgl1-mesa-dri"):
        render.Renderer(scene, CameraModel())
