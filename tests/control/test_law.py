from dataclasses import replace

import numpy as np
import pytest

from armgate.cell.errors import ModelError
from armgate.cell.model import RobotModel
from armgate.control.gains import Gains
from armgate.control.law import CameraLaw
from armgate.control.repulsion import Obstacles
from armgate.control.stereographic import camera_error
from armgate.control.subtasks import roll_angle
from armgate.control.view_errors import view_errors

P = np.array([1.7, 0.4, 1.1])


def camera(robot, q):
    return robot.model.frame(q, "camera")


def psi(robot, q, p):
    at = camera(robot, q)
    return camera_error(*(tuple(column) for column in at.R.T), tuple(p - at.t)).psi


def scene_beside(law, q):
    """Return two obstacles near the elbow that repel without touching: between contact distance and ρ0."""
    rng, elbow = np.random.default_rng(3), law.spheres.centres(q)[9]
    while True:
        away = rng.normal(size=(2, 3))
        away /= np.linalg.norm(away, axis=1, keepdims=True)
        obstacles = Obstacles(elbow + 0.42 * away, np.full(2, 0.1))
        if 0.1 < law.scene(obstacles, q).gap < 0.25:
            return obstacles


def repulsion_potential(law, obstacles, q):
    """Return ½ η (1/d − 1/ρ0)², summed over the pairs by loops."""
    gains, total = law.gains, 0.0
    for o, r_o in zip(law.spheres.centres(q), law.spheres.radii, strict=True):
        for b, r_b in zip(obstacles.centres, obstacles.radii, strict=True):
            d = np.linalg.norm(o - b) - r_o - r_b
            if d < gains.reach:
                total += 0.5 * gains.repulsion * (1.0 / d - 1.0 / gains.reach) ** 2
    return total


def test_task_jacobian_against_differences(law, fr, q, differences):
    terms = law.terms(q, law.goal(P, 1.0))
    np.testing.assert_allclose(terms.J_t, differences(lambda at: psi(fr, at, P), q), rtol=1e-5, atol=1e-6)


def test_target_jacobian_against_differences(law, fr, q, differences):
    terms = law.terms(q, law.goal(P, 1.0))
    np.testing.assert_allclose(terms.P, differences(lambda p: psi(fr, q, p), P), rtol=1e-5, atol=1e-6)


def test_distance_gradient_against_differences(law, fr, q, differences):
    terms = law.terms(q, law.goal(P, 1.0))
    numeric = differences(lambda at: np.linalg.norm(P - camera(fr, at).t), q)
    np.testing.assert_allclose(terms.J_d, numeric, rtol=1e-6, atol=1e-8)


def test_distance_force_is_the_gradient_of_its_potential(fr, q, differences):
    law = CameraLaw(fr.model, "camera", Gains(roll=0.0))

    def potential(at):
        return 0.5 * law.gains.distance * (1.0 - np.linalg.norm(P - camera(fr, at).t)) ** 2

    np.testing.assert_allclose(
        law.terms(q, law.goal(P, 1.0)).F, -differences(potential, q), rtol=1e-5, atol=1e-6
    )


def test_repulsion_is_the_gradient_of_its_potential(fr, q, differences):
    law = CameraLaw(fr.model, "camera", Gains(own_repulsion=0.0))
    obstacles = scene_beside(law, q)
    F_rep = law.terms(q, law.goal(P, 1.0, law.scene(obstacles, q))).F_rep
    assert np.abs(F_rep).max() > 1e-3
    numeric = -differences(lambda at: repulsion_potential(law, obstacles, at), q)
    np.testing.assert_allclose(F_rep, numeric, rtol=1e-4, atol=1e-6)


def test_repulsion_does_not_depend_on_the_position_for_which_its_scene_was_made(law, q):
    obstacles = scene_beside(law, q)
    near, far = law.scene(obstacles, q), law.scene(obstacles, q + 0.5)
    F_rep = [law.terms(q, law.goal(P, 1.0, scene)).F_rep for scene in (near, far)]
    np.testing.assert_array_equal(F_rep[0], F_rep[1])


def test_angle_decays_with_its_sine(law, fr, q):
    """Check θ̇ = −k_p sin θ at random positions."""
    goal = law.goal(P, 1.0)
    qd = law(q, goal)
    h = 1e-6
    theta = view_errors(fr.model, "camera", q, P, 1.0)[0]
    ahead, behind = (view_errors(fr.model, "camera", q + s * h * qd, P, 1.0)[0] for s in (1.0, -1.0))
    assert (ahead - behind) / (2 * h) == pytest.approx(-law.gains.task * np.sin(theta), rel=1e-6)


def test_task_error_decays_exponentially(law, q):
    terms = law.terms(q, law.goal(P, 1.0))
    np.testing.assert_allclose(
        terms.J_t @ law.velocity(q, terms), -law.gains.task * np.array(terms.psi), rtol=1e-10, atol=1e-12
    )


def test_null_space_part_does_not_move_the_task(law, q):
    terms = law.terms(q, law.goal(P, 1.0, law.scene(scene_beside(law, q), q)))
    bare = replace(terms, F=np.zeros(6), F_rep=np.zeros(6))
    with_fields, without = law.velocity(q, terms), law.velocity(q, bare)
    assert np.abs(with_fields - without).max() > 1e-3
    np.testing.assert_allclose(terms.J_t @ with_fields, terms.J_t @ without, atol=1e-10 * terms.steepness)


ALONE = {
    "distance": Gains(roll=0.0, repulsion=0.0),
    "roll": Gains(distance=0.0, repulsion=0.0),
    "repulsion": Gains(distance=0.0, roll=0.0),
}


@pytest.mark.parametrize("subtask", ALONE)
def test_each_subtask_alone_lowers_its_potential_and_keeps_the_view(fr, subtask, q):
    law = CameraLaw(fr.model, "camera", ALONE[subtask])
    at = camera(fr, q)
    p = at.t + 1.3 * at.R[:, 2]
    obstacles = scene_beside(law, q)
    goal = law.goal(p, 1.0, law.scene(obstacles, q) if subtask == "repulsion" else None)
    terms = law.terms(q, goal)
    qd = law.velocity(q, terms)

    def potential(here):
        if subtask == "distance":
            return (1.0 - np.linalg.norm(p - camera(fr, here).t)) ** 2
        if subtask == "roll":
            e1, e2, _ = camera(fr, here).R.T
            return roll_angle(tuple(e1), tuple(e2)) ** 2
        return repulsion_potential(law, obstacles, here)

    assert np.abs(qd).max() > 1e-5
    np.testing.assert_allclose(terms.J_t @ qd, 0.0, atol=1e-10 * max(1.0, np.abs(qd).max()))
    assert potential(q + 1e-5 * qd / np.abs(qd).max()) < potential(q)


BACKWARDS = """
  <link name="backwards"/>
  <joint name="backwards_joint" type="fixed">
    <parent link="tool0"/><child link="backwards"/><origin xyz="0 0 0" rpy="0 3.141592653589793 0"/>
  </joint>
</robot>"""


@pytest.mark.parametrize("frame", ["camera", "backwards"])
@pytest.mark.parametrize("turned", [-0.8, 0.8])
def test_roll_turns_the_picture_upright_for_every_view_direction(fr, frame, turned):
    """The sign of (15) comes from the model."""
    model = RobotModel.from_urdf(fr.urdf.replace("</robot>", BACKWARDS), fr.config.base.placement)
    law = CameraLaw(model, frame, Gains(distance=0.0))
    q = fr.start + np.array([0.0, 0.0, 0.0, 0.0, 0.0, turned])

    def roll(here):
        e1, e2, _ = model.frame(here, frame).R.T
        return abs(roll_angle(tuple(e1), tuple(e2)))

    at = model.frame(q, frame)
    qd = law(q, law.goal(at.t + at.R[:, 2], 1.0))
    assert abs(qd[5]) > 1.0
    assert roll(q + 0.01 * qd) == pytest.approx(roll(q) * (1.0 - 0.01 * law.gains.roll), rel=1e-6)


def test_roll_causes_no_motion_if_the_camera_looks_straight_down(fr):
    law = CameraLaw(fr.model, "camera", Gains(distance=0.0))
    q = np.radians([0.0, -90.0, 90.0, 0.0, 90.0, 30.0])
    at = camera(fr, q)
    assert at.R[2, 2] == pytest.approx(-1.0)
    np.testing.assert_allclose(law(q, law.goal(at.t + at.R[:, 2], 1.0)), 0.0, atol=1e-9)


def test_induced_velocity_keeps_angle_and_distance(law, fr):
    v = np.array([0.1, -0.2, 0.05])
    q = fr.start
    at = camera(fr, q)
    p = at.t + at.R[:, 2]
    qd, h = law.induced(q, law.goal(p, 1.0), v), 1e-3
    angle, distance = view_errors(fr.model, "camera", q + h * qd, p + h * v, 1.0)
    assert angle < 5e-6
    assert abs(distance) < 1e-6


def test_finite_and_bounded_at_the_antipode_and_with_the_target_in_the_lens(law, fr, q):
    at = camera(fr, q)
    for p in (at.t - at.R[:, 2], at.t, at.t + 1e-9 * at.R[:, 0]):
        qd = law(q, law.goal(p, 1.0))
        assert np.isfinite(qd).all()
        assert np.abs(qd).max() < 100.0


@pytest.mark.parametrize("limit", ["lower", "upper"])
@pytest.mark.parametrize("joint", range(6))
def test_a_joint_at_its_limit_does_not_pass_it(law, fr, joint, limit):
    q = np.array(fr.start)
    q[joint] = getattr(fr, limit)[joint]
    outward = 1.0 if limit == "upper" else -1.0
    for p in (P, [-1.0, 1.0, 0.5], [0.5, -2.0, 3.0]):
        qd = law(q, law.goal(p, 1.0))
        assert np.isfinite(qd).all()
        assert qd[joint] * outward <= 1e-9


def test_emergency_leaves_only_repulsion(law, q):
    goal = law.goal(P, 1.0, law.scene(scene_beside(law, q), q), emergency=True)
    terms, qd = law.terms(q, goal), law(q, goal)
    assert qd @ terms.F_rep > 0.0
    assert (np.abs(qd) <= np.abs(terms.F_rep)).all()


def test_a_camera_on_the_base_is_refused(fr):
    with pytest.raises(ModelError, match="fixed to the base"):
        CameraLaw(fr.model, "base_link")


def test_an_unknown_frame_is_refused(fr):
    with pytest.raises(ModelError, match="no frame 'lens'"):
        CameraLaw(fr.model, "lens")
