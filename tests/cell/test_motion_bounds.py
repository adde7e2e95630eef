import numpy as np
import pytest

from armgate.cell.model import RobotModel
from armgate.cell.motion_bounds import bend_bounds, motion_bounds
from armgate.cell.placement import Placement
from armgate.cell.shapes import Box, Sphere

LINK = (
    '<link name="{0}"><collision><origin xyz="0.1 0.05 0" rpy="0 1.2 0.3"/>'
    "<geometry>{1}</geometry></collision></link>"
)
SHAPES = (
    '<sphere radius="0.1"/>',
    '<box size="0.2 0.1 0.4"/>',
    '<cylinder radius="0.1" length="0.5"/>',
    '<capsule radius="0.05" length="0.3"/>',
    '<box size="0.02 0.5 0.1"/>',
)
KINDS = ("revolute", "prismatic", "revolute", "prismatic", "revolute")
AXES = ("0 0 1", "1 0.5 0", "0 1 0", "0 0 -1", "1 1 1")


def mixed() -> RobotModel:
    """Return a robot with alternating revolute and prismatic joints, skew axes, and bodies of four kinds."""
    links = '<link name="l0"/>' + "".join(LINK.format(f"l{i + 1}", shape) for i, shape in enumerate(SHAPES))
    joints = "".join(
        f'<joint name="J{i}" type="{kind}"><parent link="l{i}"/><child link="l{i + 1}"/>'
        f'<origin xyz="0.2 -0.1 0.3" rpy="0.3 -0.8 0.1"/><axis xyz="{axis}"/>'
        f'<limit lower="-1.5" upper="0.9" velocity="1"/></joint>'
        for i, (kind, axis) in enumerate(zip(KINDS, AXES, strict=True))
    )
    return RobotModel.from_urdf(f'<robot name="m">{links}{joints}</robot>', Placement.identity())


@pytest.fixture(scope="module")
def models(demo, planar):
    return [mixed(), *(robot.model for robot in (*demo.robots, *planar.robots))]


def surface(shape, rng):
    """Return the farthest point of the shape in a random direction."""
    d = rng.normal(size=3)
    d /= np.linalg.norm(d)
    if isinstance(shape, Sphere):
        return shape.radius * d
    if isinstance(shape, Box):
        return np.sign(d) * np.array(shape.size) / 2
    end = np.array([0, 0, np.sign(d[2]) * shape.length / 2])
    if shape.kind == "capsule":
        return end + shape.radius * d
    return end + shape.radius * np.array([d[0], d[1], 0]) / np.hypot(d[0], d[1])


def sampled(model, rng):
    """Yield random positions (ends of the travel among them), each with a point for each body."""
    for _ in range(300):
        q = rng.uniform(model.lower, model.upper)
        at_end = rng.random(model.n) < 0.3
        q = np.where(at_end, np.where(rng.random(model.n) < 0.5, model.lower, model.upper), q)
        R, t = model.body_placements(q)
        for b, body in enumerate(model.bodies):
            local = surface(body.shape, rng)
            yield q, b, body, local, R[b] @ local + t[b]


def test_no_point_moves_faster_than_its_bound(models):
    rng = np.random.default_rng(5)
    for model in models:
        R = motion_bounds(model)
        best = np.zeros_like(R)
        for q, b, body, _, point in sampled(model, rng):
            speed = np.linalg.norm(model.point_jacobian(q, body.joint, point), axis=0)
            assert (speed <= R[b] + 1e-9).all()
            best[b] = np.maximum(best[b], speed)
        # The bounds are not too loose: many are nearly reached.
        assert np.mean(best[R > 0] / R[R > 0]) > 0.7


def test_finite_moves_stay_within_the_bound(models):
    rng = np.random.default_rng(6)
    for model in models:
        R = motion_bounds(model)
        for q, b, _, local, point in sampled(model, rng):
            other = rng.uniform(model.lower, model.upper)
            Ro, to = model.body_placements(other)
            moved = np.linalg.norm(Ro[b] @ local + to[b] - point)
            assert moved <= R[b] @ np.abs(other - q) + 1e-9


def test_the_second_derivative_of_no_point_exceeds_its_bound(models):
    rng = np.random.default_rng(7)
    step = 1e-4
    for model in models:
        G = bend_bounds(model)
        assert np.array_equal(G, G.transpose(0, 2, 1))
        for count, (q, b, body, _, point) in enumerate(sampled(model, rng)):
            if count % 4:
                continue
            for i in np.flatnonzero(model.chain[b]):
                forward, backward = (
                    _slopes(model, q + s * step * np.eye(model.n)[i], q, b, body, point) for s in (1, -1)
                )
                bend = np.linalg.norm(forward - backward, axis=0) / (2 * step)
                assert (bend <= G[b, i] + 1e-5).all()


def _slopes(model, q, q0, b, body, point):
    """Return the Jacobian (3, n) at q of the point of a body that is at ``point`` at the position q0."""
    (R0, t0), (R, t) = model.body_placements(q0), model.body_placements(q)
    local = R0[b].T @ (point - t0[b])
    return model.point_jacobian(q, body.joint, R[b] @ local + t[b])


def test_the_bound_is_zero_if_a_joint_does_not_move_a_body(models):
    for model in models:
        R, G = motion_bounds(model), bend_bounds(model)
        assert not R[~model.chain].any()
        assert (R[model.chain] > 0).all()
        for b in range(len(model.bodies)):
            assert not G[b][~model.chain[b]].any()


def test_bend_bounds_of_prismatic_joints_in_front_are_zero(demo):
    R, G = motion_bounds(demo.robot("GR").model), bend_bounds(demo.robot("GR").model)
    assert (R[demo.robot("GR").model.chain[:, 0], 0] == 1.0).all()
    assert not G[:, :3].any()


def test_the_bend_bound_of_a_prismatic_joint_behind_a_revolute_one_is_one():
    G = bend_bounds(mixed())
    assert G[4, 0, 1] == G[4, 1, 0] == 1.0
    assert G[4, 1, 1] == 0.0


def test_a_straight_planar_arm_reaches_its_bounds(planar):
    R = motion_bounds(planar.robots[0].model)
    assert R[3] == pytest.approx([1.2, 0.7, 0.3])


def test_travel_outside_the_limits_can_be_included():
    model = mixed()
    wider = motion_bounds(model, upper=model.upper + np.array([0, 1.0, 0, 0, 0]), lower=model.lower - 1.0)
    assert (wider >= motion_bounds(model)).all()
    assert wider[1, 0] > motion_bounds(model)[1, 0]
