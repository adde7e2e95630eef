"""Kinematics, levers and distances of the monitor, compared with other libraries and with samples."""

from pathlib import Path

import coal
import numpy as np
import pytest

from armgate.cell.cell import build_cell
from armgate.cell.config import load_config
from armgate.monitor.braking import increment_to, rest_of
from armgate.monitor.convex_solid import SIZES, Solid, hull, primitive
from armgate.monitor.distance import PlacedSolid, distance_bounds
from armgate.monitor.kinematics import Kinematics, Reach
from armgate.monitor.mesh_files import Mesh
from armgate.monitor.mesh_solids import solids_of
from armgate.monitor.model import build
from armgate.monitor.transforms import from_quaternion
from armgate.monitor.yaml_files import read_files
from support import meshes

CONFIGS = Path(__file__).parents[2] / "configs"
CELLS = ["demo", "planar", "conformance"]


def both(name):
    return build(read_files([CONFIGS / f"{name}.yaml"])), build_cell(load_config([CONFIGS / f"{name}.yaml"]))


@pytest.mark.parametrize("name", CELLS)
def test_placements_of_bodies_agree_with_another_library(name):
    mine, theirs = both(name)
    rng = np.random.default_rng(1)
    for index, (robot, other) in enumerate(zip(mine.robots, theirs.robots, strict=True)):
        bodies = [body for body in mine.bodies if body.robot == index]
        names = [body.name for body in other.model.bodies]
        rows = [names.index(body.name.partition("/")[2]) for body in bodies]
        poses = rng.uniform(robot.lower, robot.upper, (20, robot.n))
        for pose, frames in zip(poses, Kinematics(robot).frames(poses), strict=True):
            R, t = other.model.body_placements(pose)
            places = np.array([frames[body.joint] @ body.placement for body in bodies])
            assert np.abs(places[:, :3, :3] - R[rows]).max() < 1e-12
            assert np.abs(places[:, :3, 3] - t[rows]).max() < 1e-12


@pytest.mark.parametrize("name", CELLS)
def test_bounds_and_pairs_agree_with_the_cell(name):
    mine, theirs = both(name)
    for robot, other in zip(mine.robots, theirs.robots, strict=True):
        for key in ("lower", "upper", "velocity", "acceleration", "deceleration"):
            assert np.allclose(getattr(robot, key), getattr(other, key), rtol=1e-12)
        assert (robot.period, robot.lag_window, robot.q_tolerance) == (
            other.period, other.lag_window, other.q_tolerance,
        )  # fmt: skip

    def named(cell):
        pairs = {
            frozenset((cell.bodies[p.a].name, cell.bodies[p.b].name)): (p.limit, p.kind) for p in cell.pairs
        }
        assert len(pairs) == len(cell.pairs)
        return pairs

    assert named(mine) == named(theirs)


def test_no_point_moves_farther_than_the_levers_allow():
    cell, _ = both("demo")
    rng = np.random.default_rng(2)
    for index, robot in enumerate(cell.robots):
        bodies = [body for body in cell.bodies if body.robot == index]
        reach, kinematics = Reach(robot, bodies), Kinematics(robot)
        far = np.tile(robot.upper, (1, 1)) + 0.5 * ~robot.revolute
        assert reach.covers(np.stack([robot.lower, robot.upper]))
        if not robot.revolute.all():
            assert not reach.covers(far)
            reach.extend(far)
            assert reach.covers(far)
        for _ in range(100):
            pose, joint, step = rng.uniform(robot.lower, far[0]), rng.integers(robot.n), rng.uniform(0.0, 0.3)
            moved = pose + step * (np.arange(robot.n) == joint)
            before, after = kinematics.frames(np.stack([pose, moved]))
            for row, body in enumerate(bodies):
                a, b = (_points(body, frames[body.joint]) for frames in (before, after))
                assert np.linalg.norm(b - a, axis=1).max() <= reach.lever[row, joint] * step + 1e-12


def _points(body, frame):
    place = frame @ body.placement
    return body.solid.points @ place[:3, :3].T + place[:3, 3]


# --- distances ----------------------------------------------------------------------------------------------


def random_place(rng, spread):
    q = rng.normal(size=4)
    return from_quaternion(rng.normal(size=3) * spread, q / np.linalg.norm(q))


def engine(kind, size):
    makers = {"sphere": coal.Sphere, "capsule": coal.Capsule, "cylinder": coal.Cylinder, "box": coal.Box}
    return makers.get(kind, coal.Cone)(*size)


def engine_distance(one, two, A, B):
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    request.gjk_tolerance = 1e-8
    places = [coal.Transform3s(T[:3, :3], T[:3, 3]) for T in (A, B)]
    return coal.distance(engine(*one), places[0], engine(*two), places[1], request, result)


def test_both_bounds_enclose_the_distance_of_another_engine():
    rng = np.random.default_rng(3)
    apart_count = 0
    for _ in range(1500):
        kinds = [str(kind) for kind in rng.choice(list(SIZES), 2)]
        sizes = [rng.uniform(0.05, 0.6, SIZES[kind]).tolist() for kind in kinds]
        A, B = random_place(rng, 0.0), random_place(rng, 0.8)
        found = distance_bounds(
            *(PlacedSolid(primitive(k, s, ""), T) for k, s, T in zip(kinds, sizes, (A, B), strict=True))
        )
        truth = engine_distance((kinds[0], sizes[0]), (kinds[1], sizes[1]), A, B)
        assert found.low <= found.high
        if truth > 1e-6:
            apart_count += 1
            assert found.high - found.low < 2e-7
            assert found.low - 1e-5 <= truth <= found.high + 1e-3
        else:
            assert found.low <= 1e-6
            assert found.low >= truth - 2e-3  # no plane found by the engine leaves more room
    assert apart_count > 500


def test_known_distances():
    box, ball = primitive("box", [1.0, 1.0, 1.0], ""), primitive("sphere", [0.25], "")
    rod, tip = primitive("capsule", [0.1, 1.0], ""), primitive("cone", [0.3, 0.6], "")
    cases = [
        (box, ball, [2.0, 0.0, 0.0], 1.25), (box, ball, [0.6, 0.0, 0.0], -0.15),
        (box, box, [1.0, 3.0, 0.0], 2.0), (box, box, [0.7, 0.2, 0.0], -0.3),
        (rod, rod, [0.5, 0.0, 1.2], np.hypot(0.5, 0.2) - 0.2),
        (rod, rod, [0.0, 0.0, 0.0], -0.2), (tip, ball, [0.0, 0.0, 0.75], 0.2),
        (tip, tip, [1.0, 0.0, 0.0], 0.4),
    ]  # fmt: skip
    for one, two, where, expected in cases:
        T = np.eye(4)
        T[:3, 3] = where
        found = distance_bounds(PlacedSolid(one, np.eye(4)), PlacedSolid(two, T))
        assert found.low == pytest.approx(expected, abs=1e-6)
        assert found.high >= found.low


# --- meshes -------------------------------------------------------------------------------------------------


BLOCK = meshes.blocks(meshes.BAR, (0.0, 0.2), (0.0, 0.2), (0.0, 0.2))
RING = meshes.ring(0.2, 0.3, 0.1)


def test_a_convex_piece_becomes_its_hull_and_any_other_its_triangles():
    (block,) = solids_of(Mesh(*BLOCK), (1.0, 1.0, 1.0), "parts")
    assert _inside(block, [0.1, 0.1, 0.1]) < 0.0
    (hollow,) = solids_of(Mesh(*RING), (1.0, 1.0, 1.0), "parts")
    (whole,) = solids_of(Mesh(*RING), (1.0, 1.0, 1.0), "hull")
    inner = 0.2 * np.cos(np.pi / 16)  # apothem of the hole, a polygon of 16 sides
    assert _inside(hollow, [0.0, 0.0, 0.05]) == pytest.approx(inner - 1e-3, abs=1e-5)
    assert _inside(whole, [0.0, 0.0, 0.05]) < 0.0
    assert _inside(whole, [0.0, 0.0, 0.3]) == pytest.approx(0.2 - 1e-3, abs=1e-6)


def _inside(solid: Solid, at) -> float:
    T = np.eye(4)
    T[:3, 3] = at
    return distance_bounds(PlacedSolid(solid, np.eye(4)), PlacedSolid(primitive("sphere", [1e-3], ""), T)).low


def test_separate_pieces_become_separate_solids():
    vertices, faces = BLOCK
    two = Mesh(
        np.concatenate([vertices, vertices + np.array([1.0, 0.0, 0.0])]),
        np.concatenate([faces, faces + len(vertices)]),
    )
    assert len(solids_of(two, (1.0, 1.0, 1.0), "parts")) == 2


def test_boxes_contain_all_triangles():
    """The distance to a set of triangles is the smallest distance to any of them, for any tree of boxes."""
    rng = np.random.default_rng(4)
    triangles = rng.uniform(-0.3, 0.3, (40, 1, 3)) + rng.uniform(-0.05, 0.05, (40, 3, 3))
    loose = Mesh(triangles.reshape(-1, 3), np.arange(120).reshape(-1, 3))
    solids = solids_of(loose, (1.0, 1.0, 1.0), "parts")
    for _ in range(20):
        T = random_place(rng, 0.6)
        ball = PlacedSolid(primitive("sphere", [0.02], ""), T)
        tree = min(distance_bounds(PlacedSolid(solid, np.eye(4)), ball).low for solid in solids)
        each = min(distance_bounds(PlacedSolid(hull(t), np.eye(4)), ball).low for t in triangles)
        assert tree == pytest.approx(each, abs=1e-6)


# --- stops --------------------------------------------------------------------------------------------------


def test_the_stop_distance_is_the_sum_of_the_braking_increments():
    rng = np.random.default_rng(5)
    for _ in range(200):
        u, decel = rng.normal(size=4) * 1e-2, rng.uniform(1e-4, 1e-3, 4)
        m = np.max(np.abs(u) / decel)
        expected = sum((u * (1.0 - k / m) for k in range(1, int(m) + 1)), np.zeros(4))
        assert rest_of(u, decel) == pytest.approx(expected, abs=1e-12)
        assert increment_to(u + rest_of(u, decel), decel) == pytest.approx(u, abs=1e-9)
    assert not rest_of(np.array([1.0]), np.array([np.inf])).any()
