import numpy as np
import pytest

from armgate.apps.errors import AppError
from armgate.apps.view import colours
from armgate.apps.view import scene as scenes
from armgate.apps.view.scene import Poses
from armgate.apps.view.viewpoint import initial_viewpoint

rng = np.random.default_rng(4)


def test_links_are_drawn_at_the_poses_of_the_gates_bodies(cell, scene):
    poses = Poses(scene)
    for robot in cell.robots:
        q = rng.uniform(robot.lower, robot.upper)
        links = poses.links(robot.name, q)
        _, t = robot.model.body_placements(q)
        described = [body for body in scene.description.bodies if body.robot == robot.name]
        assert len(described) == len(robot.model.bodies)
        for k, body in enumerate(described):
            at = links[body.link].apply(np.array(body.xyz))
            assert at == pytest.approx(t[k], abs=1e-9)
            drawn = np.concatenate([piece.mesh.vertices for piece in _of(scene, robot.name)[body.link]])
            inside = robot.model.bodies[k].shape.bounding_radius
            assert np.linalg.norm(links[body.link].apply(drawn) - at, axis=1).min() <= inside + 1e-9


def _of(scene, name):
    return next(robot for robot in scene.robots if robot.name == name).pieces


def test_every_body_is_drawn_in_its_colour(scene):
    used = {piece.colour for robot in scene.robots for pieces in robot.pieces.values() for piece in pieces}
    assert {colours.ARM, colours.STRUCTURE, colours.HAND, colours.TOOL} <= used
    standing = {piece.colour for piece in scene.surroundings}
    assert colours.FLOOR in standing
    assert colours.surrounding("tank") in standing
    assert scene.camera_robot.name == "FR"


def test_colours_of_margins_range_from_red_to_green():
    assert colours.margin(0.05, 0.05) == colours.margin(0.0, 0.05) == colours.STATES["stop"]
    assert colours.margin(0.2, 0.05) == colours.margin(9.0, 0.05) == colours.STATES["clear"]
    assert colours.margin(0.125, 0.05) == colours.STATES["near"]


def test_the_initial_viewpoint_is_above_the_floor_and_outside(scene):
    eye, at = initial_viewpoint(scene)
    assert eye[2] > at[2] > 0.0
    assert np.linalg.norm(np.subtract(eye, at)) > 3.0


@pytest.mark.parametrize(
    ("data", "what"),
    [
        (b"\xff\xfe", "is not text in UTF-8"),
        (b"v 0 0 zero\nf 1 1 1\n", "is not a convex mesh"),
        (b"v 0 0 0\nf 1 2 3\n", "is not a convex mesh"),
        (b"v 0 0\n\n", "is not a convex mesh"),
        (b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3 4\n", "is not a convex mesh"),
        (b"", "is not a convex mesh"),
    ],
)
def test_an_asset_that_cannot_be_drawn_is_named(data, what):
    with pytest.raises(AppError, match=f"asset 123456789012… {what}"):
        scenes._hull(scenes._text(lambda name: data, "1234567890123"), "1234567890123")
