import math

import numpy as np
import pytest

from armgate.apps.view import colours
from armgate.apps.view.overlays import SPEED, ellipsoid, moves_visibly, nearest_lines
from armgate.apps.view.scene import Poses
from armgate.client import Entry


def entry(**more):
    return Entry.model_validate({"robot": "FR", "tick": 1, "time": 0.1} | more)


def near(a, b, distance, x=0.0):
    return {
        "pair": (a, b),
        "distance": distance,
        "limit": 0.05,
        "points": ((x, 0.0, 0.0), (x, 0.0, distance)),
    }


def test_each_pair_is_drawn_once_the_nearest_first():
    first = entry(nearest=(near("FR/a", "GR/b", 0.3), near("FR/a", "floor", 0.06)))
    second = entry(robot="GR", nearest=(near("GR/b", "FR/a", 0.25, x=1.0),))
    lines = nearest_lines((first, second))
    assert [points[0][0] for points, _ in lines] == [0.0, 1.0]
    assert lines[0][1] == colours.margin(0.06, 0.05)
    assert lines[1][1] == colours.STATES["clear"]


def test_pairs_without_witness_points_are_not_drawn():
    assert nearest_lines((entry(nearest=({"pair": ("a", "b"), "distance": 1.0, "limit": 0.05},)),)) == []


def test_a_stop_path_is_drawn_only_if_the_robot_would_still_move():
    assert moves_visibly(entry(q=(0.0, 0.0), stop_end=(0.0, 0.1)))
    assert not moves_visibly(entry(q=(0.0, 0.1), stop_end=(0.0, 0.1)))
    assert not moves_visibly(entry(q=(0.0, 0.1)))


def test_the_ellipsoid_contains_every_velocity_of_unit_joint_speeds(scene):
    poses = Poses(scene)
    robot = scene.robots[0]
    q = np.array(robot.described.start)
    place, lengths = ellipsoid(poses, entry(q=tuple(q)), robot.described.tool)
    J = poses.models["FR"].frame_jacobian(q, robot.described.tool)[:3]
    rng = np.random.default_rng(1)
    speeds = rng.normal(size=(200, 6))
    speeds /= np.linalg.norm(speeds, axis=1, keepdims=True)
    inside = np.linalg.norm((speeds @ J.T) @ place.R / (np.array(lengths) / SPEED), axis=1)
    assert inside.max() <= 1.0 + 1e-9
    assert inside.max() > 0.8
    assert math.isclose(np.linalg.det(place.R), 1.0)
    assert place.t == pytest.approx(poses.models["FR"].frame(q, robot.described.tool).t)
