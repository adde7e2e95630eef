"""Tests of the demo cell with an independent engine: clearances at the start and in the working area."""

import coal
import numpy as np
import pytest

GEOMETRIES = {"sphere": coal.Sphere, "capsule": coal.Capsule, "cylinder": coal.Cylinder, "box": coal.Box}


@pytest.fixture(scope="module")
def geometries(demo):
    return [GEOMETRIES[body.shape.kind](*body.shape.size) for body in demo.bodies]


def distances(demo, geometries, positions):
    """Return the distance of every pair by the names of its bodies."""
    places = [
        coal.Transform3s(np.ascontiguousarray(R), np.ascontiguousarray(t))
        for robot, q in zip(demo.robots, positions, strict=True)
        for R, t in zip(*robot.model.body_placements(q), strict=True)
    ]
    places += [coal.Transform3s(np.array(b.placement.R), np.array(b.placement.t)) for b in demo.surroundings]
    request = coal.DistanceRequest()
    request.gjk_tolerance = 1e-8
    return {
        pair: coal.distance(
            geometries[pair.a],
            places[pair.a],
            geometries[pair.b],
            places[pair.b],
            request,
            coal.DistanceResult(),
        )
        for pair in demo.pairs
    }


def least(found, kind):
    return min(distance for pair, distance in found.items() if pair.kind == kind)


def test_the_start_has_wide_clearances(demo, geometries):
    found = distances(demo, geometries, [robot.start for robot in demo.robots])
    assert least(found, "self") > 0.09
    assert least(found, "robots") > 0.5
    assert least(found, "surroundings") > 0.35


def test_the_working_area_is_clear(demo, geometries):
    rng = np.random.default_rng(8)
    follower, leader = (robot.start for robot in demo.robots)
    for _ in range(150):
        at = np.array([*rng.uniform([2.6, -0.7, 2.1], [3.3, 0.7, 2.9]), *leader[3:]])
        found = distances(demo, geometries, [follower + np.radians(rng.uniform(-25, 25, 6)), at])
        assert least(found, "self") > 0.09
        assert least(found, "robots") > 0.15
        assert least(found, "surroundings") > 0.15


def test_the_floor_robot_never_reaches_the_gantry(demo, geometries):
    rng = np.random.default_rng(9)
    robot, leader = demo.robots[0], demo.robots[1].start
    fixed = [i for i, body in enumerate(demo.bodies) if "gantry_" in body.name and "column" not in body.name]
    for _ in range(100):
        found = distances(demo, geometries, [rng.uniform(robot.lower, robot.upper), leader])
        to_gantry = [d for pair, d in found.items() if pair.b in fixed and pair.kind == "robots"]
        assert min(to_gantry) > 0.05


def test_the_flange_is_clear_of_the_forearm_over_the_range_of_the_wrist(demo, geometries):
    names = [body.name for body in demo.bodies]
    forearm = names.index("FR/link_4")
    for a5 in np.radians(np.linspace(-130, 130, 53)):
        found = distances(demo, geometries, [[0, -1.57, 1.57, 0.7, a5, 0.3], demo.robots[1].start])
        assert min(d for pair, d in found.items() if pair.a == forearm and pair.kind == "self") > 0.02
