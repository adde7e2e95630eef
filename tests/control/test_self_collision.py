"""Repulsion of the robot from itself: its pairs, its force, and its null-space projection."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from armgate.control.gains import Gains
from armgate.control.law import CameraLaw
from armgate.control.repulsion import Obstacles
from armgate.control.spheres import Spheres
from support.follow_rig import still

P = np.array([1.7, 0.4, 1.1])
# The hand before the forearm; the hand beside the base; the forearm along the upper arm.
FOLDED = {
    "hand and forearm": np.radians([0.0, -94.0, 108.0, 0.0, 123.0, 0.0]),
    "hand and base": np.radians([10.0, -60.0, 143.0, 20.0, 30.0, 0.0]),
    "forearm and upper arm": np.radians([0.0, -60.0, 142.0, 0.0, -40.0, 10.0]),
}


@pytest.fixture(params=FOLDED)
def folded(request):
    return FOLDED[request.param]


def own_pairs(model, q):
    """Return distances of own spheres two joints apart or more, by loops; the robot is a chain."""
    moving, base = Spheres.of(model), Spheres.of_base(model)
    every = [
        (joint, centre, radius)
        for spheres in (base, moving)
        for joint, centre, radius in zip(spheres.joints, spheres.centres(q), spheres.radii, strict=True)
    ]
    for (i, o, r), (j, b, s) in itertools.combinations(every, 2):
        if abs(i - j) >= 2:
            yield float(np.linalg.norm(o - b)) - r - s


def potential(law, q):
    gains, total = law.gains, 0.0
    for d in own_pairs(law.model, q):
        if d < gains.own_reach:
            total += 0.5 * gains.own_repulsion * (1.0 / d - 1.0 / gains.own_reach) ** 2
    return total


def terms(law, q):
    return law.terms(q, law.goal(P, 1.0, law.scene(Obstacles(), q)))


def test_the_force_is_the_gradient_of_its_potential(law, folded, differences):
    assert min(own_pairs(law.model, folded)) > law.gains.contact
    F = terms(law, folded).F_rep
    assert np.abs(F).max() > 1e-3
    np.testing.assert_allclose(F, -differences(lambda at: potential(law, at), folded), rtol=1e-4, atol=1e-6)


def test_joints_that_carry_both_spheres_get_no_force(law):
    """Check the forearm along the upper arm: A3 moves them apart, while A1 and A2 carry both."""
    F = terms(law, FOLDED["forearm and upper arm"]).F_rep
    assert F[2] < -0.1
    np.testing.assert_array_equal(F[:2], 0.0)


def test_the_least_gap_is_that_of_the_nearest_pair(law, folded):
    assert law.scene(Obstacles(), folded).own_gap == pytest.approx(min(own_pairs(law.model, folded)))


def test_in_the_middle_of_its_range_no_sphere_repels(law, fr):
    scene = law.scene(Obstacles(), fr.start)
    assert scene.own_gap > law.gains.own_reach
    np.testing.assert_array_equal(terms(law, fr.start).F_rep, 0.0)


def test_own_repulsion_keeps_the_view(law, folded):
    own = terms(law, folded)
    with_it, without = law.velocity(folded, own), law.velocity(folded, replace(own, F_rep=np.zeros(6)))
    assert np.abs(with_it - without).max() > 1e-3
    np.testing.assert_allclose(own.J_t @ with_it, own.J_t @ without, atol=1e-10 * own.steepness)


def test_own_repulsion_opens_the_arm(fr, folded):
    law = CameraLaw(fr.model, "camera", Gains(distance=0.0, roll=0.0))
    own = terms(law, folded)
    qd = law.velocity(folded, own) - law.velocity(folded, replace(own, F_rep=np.zeros(6)))
    h = 1e-6 / np.abs(qd).max()
    assert potential(law, folded + h * qd) < potential(law, folded)


def test_a_camera_that_turns_around_stays_clear_of_its_arm(loop, fr):
    """Check starts near the limits of A1: the shortest turn of the camera leads through the base."""
    for share in (-0.999, 0.999):
        start = np.array(fr.start)
        start[0] = share * fr.upper[0]
        trace = loop.run(still([2.0, 0.0, 1.0]), 4.0, start=start, obstacles=lambda _: Obstacles())
        gaps = [min(own_pairs(fr.model, q)) for q in trace.q]
        assert min(gaps) > 0.02
        assert min(gaps) < loop.law.gains.own_reach
        assert np.degrees(trace.angle[-1]) < 0.1
