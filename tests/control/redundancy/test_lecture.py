"""The planar examples of the lecture, by URDF, with its numbers, corrected where they are wrong."""

import numpy as np
import pytest

from armgate.control.redundancy.ellipsoids import force_ellipsoid, velocity_ellipsoid
from armgate.control.redundancy.inverses import damped_inverse, pseudoinverse
from armgate.control.redundancy.measures import condition_number, isotropy, manipulability
from armgate.control.redundancy.spaces import spaces
from armgate.control.redundancy.tasks import FrameTask

LINKS = (0.5, 0.4, 0.3)
SQRT_HALF = np.sqrt(0.5)


def tip(model):
    return FrameTask(model, "tip", ("x", "y"))


@pytest.mark.parametrize("seed", range(5))
def test_slide_6_and_26_the_jacobian_is_the_printed_one(seed, arm, printed_jacobian):
    q = np.random.default_rng(seed).uniform(-3.0, 3.0, 3)
    np.testing.assert_allclose(tip(arm(*LINKS)).jacobian(q), printed_jacobian(LINKS, q), atol=1e-14)


def test_slides_5_to_7_no_velocity_along_y_if_the_arm_lies_along_y(arm):
    l1, l2, l3 = LINKS
    J = tip(arm(*LINKS)).jacobian([np.pi / 2, 0.0, np.pi])
    np.testing.assert_allclose(J, [[-l1 - l2 + l3, -l2 + l3, l3], [0.0, 0.0, 0.0]], atol=1e-15)
    assert np.linalg.det(J @ J.T) == pytest.approx(0.0, abs=1e-16)
    found = spaces(J)
    assert (found.singular, found.rank) == (True, 1)
    np.testing.assert_allclose(np.abs(found.singular_directions[:, 0]), [0.0, 1.0], atol=1e-15)


def test_slide_8_the_four_singularities_of_the_three_link_arm(arm):
    task = tip(arm(*LINKS))
    straight = [(a, b) for a in (0.0, np.pi) for b in (0.0, np.pi)]
    for q2, q3 in straight:
        assert spaces(task.jacobian([0.7, q2, q3])).singular
    for q2 in np.linspace(-3.0, 3.0, 13):
        for q3 in np.linspace(-3.0, 3.0, 13):
            assert spaces(task.jacobian([0.7, q2, q3])).singular == (q2 == q3 == 0.0)


def test_slide_10_near_a_singularity_the_pseudoinverse_diverges_and_the_transpose_vanishes(arm):
    task = tip(arm(1.0, 1.0))
    big, small = [], []
    for bend in (1e-1, 1e-2, 1e-3):
        J = task.jacobian([0.0, bend])
        direction = spaces(J).U[:, -1]
        big.append(np.linalg.norm(pseudoinverse(J) @ direction))
        small.append(np.linalg.norm(J.T @ direction))
    np.testing.assert_allclose(big[1:] / np.array(big[:-1]), 10.0, rtol=0.02)
    np.testing.assert_allclose(small[1:] / np.array(small[:-1]), 0.1, rtol=0.02)
    np.testing.assert_allclose(np.array(big) * small, 1.0)


def test_slide_12_damping_trades_exactness_for_speed_near_a_singularity(arm):
    J = tip(arm(1.0, 1.0)).jacobian([0.0, 1e-4])
    direction, k = spaces(J).U[:, -1], 0.1
    assert np.linalg.norm(pseudoinverse(J) @ direction) > 1e4
    assert np.linalg.norm(damped_inverse(J, k) @ direction) < 0.01
    far = tip(arm(1.0, 1.0)).jacobian([0.0, np.pi / 2])
    assert np.linalg.norm(far @ damped_inverse(far, 0.01) - np.eye(2)) < 1e-3


def test_slides_18_to_21_lengths_are_singular_values_whose_squares_are_the_eigenvalues(arm):
    J = tip(arm(*LINKS)).jacobian([0.3, 0.8, -0.5])
    squared = np.linalg.eigvalsh(J @ J.T)[::-1]
    ellipsoid = velocity_ellipsoid(J)
    np.testing.assert_allclose(ellipsoid.lengths, np.sqrt(squared))
    assert np.abs(ellipsoid.lengths - squared).min() > 0.01
    assert manipulability(J) == pytest.approx(np.sqrt(np.linalg.det(J @ J.T)))
    assert condition_number(J) == pytest.approx(np.sqrt(squared[0] / squared[1]))


def test_slide_22_the_two_link_arm_with_lengths_root_of_two_and_one_is_isotropic_at_135_degrees(arm):
    J = tip(arm(np.sqrt(2.0), 1.0)).jacobian([0.4, 0.75 * np.pi])
    assert isotropy(J) == pytest.approx(1.0)
    assert condition_number(J) == pytest.approx(1.0)
    # With equal links it is not isotropic at any angle.
    equal = tip(arm(1.0, 1.0))
    assert max(isotropy(equal.jacobian([0.0, bend])) for bend in np.linspace(0.0, np.pi, 500)) < 0.62


def test_slides_24_and_25_force_and_velocity_share_axes_and_have_reciprocal_lengths(arm):
    J = tip(arm(1.0, 1.0)).jacobian([0.0, np.pi / 4])
    velocity, force = velocity_ellipsoid(J), force_ellipsoid(J)
    np.testing.assert_allclose(np.abs(velocity.axes.T @ force.axes), np.eye(2), atol=1e-14)
    np.testing.assert_allclose(velocity.lengths * force.lengths, 1.0)


def test_slide_26_principal_axes_of_the_two_link_arm(arm):
    J = tip(arm(1.0, 1.0)).jacobian([0.0, np.pi / 4])
    np.testing.assert_allclose(J, [[-SQRT_HALF, -SQRT_HALF], [1.0 + SQRT_HALF, SQRT_HALF]])
    # Printed with the off-diagonal elements −1 + 1/√2.
    off = -1.0 - SQRT_HALF
    np.testing.assert_allclose(J @ J.T, [[1.0, off], [off, 2.0 + np.sqrt(2.0)]])
    axes = velocity_ellipsoid(J).semi_axes.T
    printed = np.array([[-0.9530, 1.8411], [-0.3029, -0.1568]])
    signs = np.sign((axes * printed).sum(axis=1, keepdims=True))
    np.testing.assert_allclose(signs * axes, printed, atol=5e-5)


def test_slides_27_to_33_manipulability_and_redundancy_degrees_of_the_three_link_arm(arm):
    task = tip(arm(*LINKS))
    regular, singular = spaces(task.jacobian([0.3, 0.8, -0.5])), spaces(task.jacobian([0.3, 0.0, 0.0]))
    assert (regular.degree_of_manipulability, regular.degree_of_redundancy) == (2, 1)
    assert (singular.degree_of_manipulability, singular.degree_of_redundancy) == (1, 2)


def test_slide_9_the_arm_with_a_shoulder_loses_one_direction_in_each_singularity():
    from armgate.cell.model import RobotModel
    from armgate.cell.placement import Placement

    joints = [("z", "0 0 1", "0 0 0.4"), ("y", "0 -1 0", "0 0 0"), ("y", "0 -1 0", "0.5 0 0")]
    text = '<robot name="shoulder"><link name="l0"/>'
    for i, (_, axis, xyz) in enumerate(joints):
        text += (
            f'<link name="l{i + 1}"/><joint name="J{i}" type="revolute"><parent link="l{i}"/>'
            f'<child link="l{i + 1}"/><origin xyz="{xyz}"/><axis xyz="{axis}"/>'
            '<limit lower="-3" upper="3" velocity="1" effort="0"/></joint>'
        )
    text += (
        '<link name="tip"/><joint name="e" type="fixed"><parent link="l3"/><child link="tip"/>'
        '<origin xyz="0.4 0 0"/></joint></robot>'
    )
    task = FrameTask(RobotModel.from_urdf(text, Placement.identity()), "tip", ("x", "y", "z"))
    assert not spaces(task.jacobian([0.0, 0.5, 0.7])).singular
    # Stretched: not along the arm, which points up by 0.5 rad from x.
    stretched = spaces(task.jacobian([0.0, 0.5, 0.0]))
    np.testing.assert_allclose(
        np.abs(stretched.singular_directions[:, 0]), [np.cos(0.5), 0.0, np.sin(0.5)], atol=1e-12
    )
    # Tip above the shoulder, 0.5 c2 + 0.4 c23 = 0: not across.
    q2 = 1.0
    q3 = np.arccos(-0.5 * np.cos(q2) / 0.4) - q2
    above = spaces(task.jacobian([0.0, q2, q3]))
    assert above.singular
    np.testing.assert_allclose(np.abs(above.singular_directions[:, 0]), [0.0, 1.0, 0.0], atol=1e-12)
