"""The oracle: its kinematics against pinocchio's, its distances against brute force."""

import numpy as np
import pytest

from gate import scenes
from gate.oracle import Oracle, rotation, segments_apart, step_faults
from gate.solids import Solid, hull_faces, nearest_in_hull


@pytest.mark.daily(3)
@pytest.mark.parametrize("name", sorted(scenes.SCENES))
def test_kinematics_agree_with_the_model(name):
    cell, rng = scenes.SCENES[name](), np.random.default_rng(0)
    oracle = Oracle(cell)
    qs = [rng.uniform(r.lower, r.upper, (5, r.model.n)) for r in cell.robots]
    R, t = oracle.place(qs)
    for q, robot in zip(qs, cell.robots, strict=True):
        at = [oracle.names.index(f"{robot.name}/{b.name}") for b in robot.model.bodies]
        for k in range(5):
            Rm, tm = robot.model.body_placements(q[k])
            assert np.allclose(R[k, at], Rm, atol=1e-12)
            assert np.allclose(t[k, at], tm, atol=1e-12)


def test_segments_are_as_far_apart_as_their_nearest_points():
    rng = np.random.default_rng(1)
    p, u, q, v = (rng.uniform(-1, 1, (200, 3)) for _ in range(4))
    s = np.linspace(-1, 1, 101)
    a = p[:, None] + s[:, None] * u[:, None]
    b = q[:, None] + s[:, None] * v[:, None]
    brute = np.linalg.norm(a[:, :, None] - b[:, None], axis=-1).min(axis=(1, 2))
    d = segments_apart(p, u, q, v)
    assert np.all(d <= brute + 1e-12)
    assert np.all(d >= brute - 0.03)


@pytest.mark.daily(2)
@pytest.mark.parametrize("name", ["duel", "corner", "wire", "tree", "mesh"])
def test_brackets_are_tight_and_lower_bounds_hold(name):
    cell, rng = scenes.SCENES[name](), np.random.default_rng(2)
    oracle = Oracle(cell)
    qs = [rng.uniform(r.lower, r.upper, (40, r.model.n)) for r in cell.robots]
    R, t = oracle.place(qs)
    low = oracle.below(R, t)
    for k in range(40):
        for pair in range(len(oracle.pairs)):
            apart = oracle.apart(pair, R[k], t[k])
            assert apart.low <= apart.high + 1e-9
            assert low[k, pair] <= apart.high + 1e-7
            if apart.high > 1e-3:
                assert apart.high - apart.low < 1e-4


BLOCK = np.array([(x, y, z) for x in (-0.1, 0.1) for y in (-0.2, 0.2) for z in (-0.05, 0.05)])


def test_a_convex_body_contains_its_corners_and_radius():
    """A block by its corners against a box of the same size; then both rounded."""
    rng = np.random.default_rng(3)
    sharp, rounded = Solid("a", "convex", (0.0,), BLOCK), Solid("b", "convex", (0.02,), BLOCK)
    box = Solid("c", "box", (0.2, 0.4, 0.1))
    for x in rng.uniform(-0.25, 0.25, (300, 3)):
        off = np.linalg.norm(x - np.clip(x, BLOCK.min(axis=0), BLOCK.max(axis=0)))
        assert np.linalg.norm(x - nearest_in_hull(BLOCK, x)) == pytest.approx(off, abs=1e-6)
        assert sharp.holds(x, 1e-7) == box.holds(x, 1e-7)
        assert rounded.holds(x, 1e-7) == (off <= 0.02 + 1e-7)
        assert sharp.reach(x) == pytest.approx(box.reach(x))


def test_a_cone_contains_the_points_between_its_tip_and_its_base():
    cone = Solid("a", "cone", (0.1, 0.4))
    for level, z, inside in ((0.0, 0.2, 1), (0.0, 0.201, 0), (0.1, -0.2, 1), (0.101, -0.2, 0),
                             (0.0, -0.201, 0), (0.05, 0.0, 1), (0.052, 0.0, 0), (0.049, 0.0, 1)):  # fmt: skip
        assert cone.holds(np.array([0.0, level, z]), 1e-9) == bool(inside)
    assert cone.reach(np.array([0.0, 0.0, 1.0])) == pytest.approx(0.2)
    assert cone.reach(np.array([1.0, 0.0, 0.0])) == pytest.approx(0.1)
    assert cone.reach(np.array([0.0, 0.0, -2.0])) == pytest.approx(0.4)


def test_faces_of_a_hull_close_around_it():
    vertices, faces = hull_faces(np.concatenate([BLOCK, np.zeros((1, 3))]))
    assert (len(vertices), len(faces)) == (8, 12)  # the inner point is not a corner
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    assert np.einsum("ki,ki->k", a, np.cross(b, c)).sum() / 6.0 == pytest.approx(0.2 * 0.4 * 0.1)


def test_the_parts_of_the_mesh_scene_contain_the_meshes():
    """A robot clear of the parts is then clear of the meshes; the engines query only the parts."""
    cell, rng = scenes.mesh(), np.random.default_rng(4)
    oracle = Oracle(cell)
    bodies = {b.name: (np.array(b.placement.R), np.array(b.placement.t)) for b in cell.bodies}
    upright = rotation((np.pi / 2, 0.0, np.pi / 2))
    for name, (vertices, faces), Q, at in (
        ("A/L2", scenes.fork(), np.eye(3), (0.1, 0.0, -0.03)),
        ("frame", scenes.frame(), upright, (0.75, 0.0, 0.7)),
    ):
        parts = [(s, *bodies[n]) for n, s in zip(oracle.names, oracle.solids, strict=True)
                 if n.startswith(f"{name}/")]  # fmt: skip
        assert len(parts) > 1
        weights = rng.dirichlet((1, 1, 1), (len(faces), 5))
        inner = np.einsum("fkc,fci->fki", weights, vertices[faces]).reshape(-1, 3)
        for x in np.concatenate([vertices, inner]) @ Q.T + at:
            assert any(solid.holds(R.T @ (x - t), 1e-7) for solid, R, t in parts)


def test_the_one_bad_position_among_many_is_found():
    cell = scenes.lane()
    oracle = Oracle(cell)
    xs = np.linspace(-1.0, 0.39, 200)
    good = np.stack([xs, np.zeros(200)], axis=1)
    assert oracle.least([good]).broken == []
    assert oracle.least([good]).margin == pytest.approx(0.01, abs=1e-6)
    bad = good.copy()
    bad[77, 0] = 0.4002
    ((at, pair, d),) = oracle.least([bad]).broken
    assert (at, pair) == (77, 0)
    assert d == pytest.approx(0.0498, abs=1e-6)


def test_violated_joint_bounds_are_named():
    robot = scenes.lane().robots[0]
    a = 4 * 0.012**2
    q = (0.0, 0.0)
    assert list(step_faults(robot, (0.0, 0.0), (a, 0.0), q)) == []
    assert list(step_faults(robot, (0.0, 0.0), (1.01 * a, 0.0), q)) != []
    assert list(step_faults(robot, (a, 0.0), (-0.01 * a, 0.0), q)) != []
    assert list(step_faults(robot, (0.012, 0.0), (0.0121, 0.0), q)) != []
    assert list(step_faults(robot, (0.0, 0.0), (0.0, 0.0), (2.1, 0.0))) != []
