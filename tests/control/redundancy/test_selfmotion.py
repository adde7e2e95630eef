"""Self-motions (slide 29) keep the task pose; those of the planar arm are known in closed form."""

import numpy as np
import pytest

from armgate.control.redundancy.selfmotion import Ended, trace_self_motion
from armgate.control.redundancy.tasks import FrameTask

LINKS = (0.5, 0.4, 0.3)


def planar_task(arm):
    return FrameTask(arm(*LINKS), "tip", ("x", "y"))


def closed_form(tip, heading):
    """Yield the two positions, one for each elbow, that reach the tip with the last link at this heading."""
    l1, l2, l3 = LINKS
    wrist = tip - l3 * np.array([np.cos(heading), np.sin(heading)])
    cosine = (wrist @ wrist - l1 * l1 - l2 * l2) / (2.0 * l1 * l2)
    for elbow in (1.0, -1.0):
        q2 = elbow * np.arccos(np.clip(cosine, -1.0, 1.0))
        q1 = np.arctan2(wrist[1], wrist[0]) - np.arctan2(l2 * np.sin(q2), l1 + l2 * np.cos(q2))
        yield np.array([q1, q2, heading - q1 - q2])


def turns_apart(a, b):
    return np.abs(np.remainder(a - b + np.pi, 2.0 * np.pi) - np.pi).max()


def test_holds_the_task(redundant):
    for _ in range(3):
        q = redundant.q()
        place = redundant.task.place(q)
        found = trace_self_motion(redundant.task, q, step=0.05, budget=200, limited=False)
        assert len(found.q) > 20
        errors = [np.abs(redundant.task.error(q, place)).max() for q in found.q]
        assert max(errors) < 1e-8
        steps = np.linalg.norm(np.diff(found.q, axis=0), axis=1)
        assert steps.max() < 0.06 + (2.0 * np.pi if found.ended is Ended.CLOSED else 0.0)


@pytest.mark.parametrize("start", [(0.3, 0.8, 0.9), (0.0, 1.5, 1.5), (-1.0, -0.6, 2.0)])
def test_the_self_motion_of_the_planar_arm_lies_on_the_known_curve_and_closes(arm, start):
    task = planar_task(arm)
    tip = task.place(start).t[:2]
    found = trace_self_motion(task, start, limited=False)
    assert found.ended is Ended.CLOSED
    assert turns_apart(found.q[0], found.q[-1]) < 1e-9
    for q in found.q:
        assert min(turns_apart(q, known) for known in closed_form(tip, q.sum())) < 1e-6


@pytest.mark.parametrize(("start", "elbows"), [((0.3, 0.8, 0.4), (1, -1)), ((0.0, 1.5, 1.5), (1,))])
def test_the_self_motion_of_the_planar_arm_is_the_whole_curve(arm, start, elbows):
    """Check that the curve has all headings of the closed form, and both elbows if the arm can stretch.

    With the tip near the base, the two links to the wrist cannot be stretched or folded. Then the two elbows
    are on two separate curves.
    """
    task = planar_task(arm)
    tip = task.place(start).t[:2]
    found = trace_self_motion(task, start, limited=False)
    count = 0
    for heading in np.linspace(-np.pi, np.pi, 120):
        wrist = tip - LINKS[2] * np.array([np.cos(heading), np.sin(heading)])
        if 0.1 < np.linalg.norm(wrist) < 0.9:
            for elbow, known in zip((1, -1), closed_form(tip, heading), strict=True):
                apart = min(turns_apart(q, known) for q in found.q)
                assert (apart < 0.05) == (elbow in elbows)
                count += 1
    assert count > 60


def test_tracing_starts_along_a_given_direction_or_its_opposite(arm):
    task, start = planar_task(arm), np.array([0.3, 0.8, 0.9])
    there = trace_self_motion(task, start, budget=5, along=[1.0, 0.0, 0.0])
    back = trace_self_motion(task, start, budget=5, along=[-1.0, 0.0, 0.0])
    assert there.ended is back.ended is Ended.BUDGET
    assert (there.q[-1] - start)[0] > 0.0 > (back.q[-1] - start)[0]


def test_joint_limits_end_the_curve(models):
    task = FrameTask(models["P"], "tool0", ("x", "y"))
    low, high = models["P"].lower, models["P"].upper
    start = np.array([0.3, 0.8, 2.0])
    ends = [trace_self_motion(task, start, along=along) for along in ([1.0, 0, 0], [-1.0, 0, 0])]
    assert {end.ended for end in ends} == {Ended.LIMIT}
    for end in ends:
        assert ((end.q >= low) & (end.q <= high)).all()
        assert np.minimum(end.q[-1] - low, high - end.q[-1]).min() < 0.02


def test_no_self_motion_is_an_error(arm):
    two = FrameTask(arm(1.0, 1.0), "tip", ("x", "y"))
    with pytest.raises(ValueError, match="no self-motion"):
        trace_self_motion(two, [0.1, 0.5])
    task = planar_task(arm)
    q = np.array([0.3, 0.8, 0.9])
    with pytest.raises(ValueError, match="no part in the null space"):
        trace_self_motion(task, q, along=task.jacobian(q)[0])
    with pytest.raises(ValueError, match="the start has the shape"):
        trace_self_motion(task, [0.1, 0.5])


def test_a_step_too_long_for_a_bend_is_shortened(arm):
    task, start = planar_task(arm), np.array([0.3, 0.8, 0.4])
    place = task.place(start)
    found = trace_self_motion(task, start, step=1.0, limited=False)
    assert found.ended is Ended.CLOSED
    assert max(np.abs(task.error(q, place)).max() for q in found.q) < 1e-8
    assert np.linalg.norm(np.diff(found.q[:-1], axis=0), axis=1).min() < 0.8


def test_a_task_without_a_continuation_is_stuck(arm):
    class Drifting(FrameTask):
        """Task whose error never vanishes."""

        def error(self, q, target):
            return super().error(q, target) + 1.0

    task = Drifting(arm(*LINKS), "tip", ("x", "y"))
    found = trace_self_motion(task, [0.3, 0.8, 0.4])
    assert (found.ended, len(found.q)) == (Ended.STUCK, 1)
