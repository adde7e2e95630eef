"""When a page that drives wants something of its robot."""

import numpy as np
import pytest

from armgate.apps.lead.motions import JointRate, JointTarget, MotionRequest, RobotState
from armgate.apps.view.pointer_input import FRESH, PointerInput

HOME = np.array([0.1, 0.2, 0.3])
MOTION = JointRate(np.ones(3))


@pytest.fixture
def grip(clock):
    return PointerInput(clock)


def wish(grip, setpoint=HOME):
    return grip.request(RobotState(0.0, setpoint, setpoint))


def test_nothing_is_wanted_unless_the_pointer_is_held(grip):
    assert wish(grip) == MotionRequest()
    grip.pull(MOTION)
    assert wish(grip) == MotionRequest()
    assert not grip.pulling
    grip.beat()
    assert wish(grip) == MotionRequest()  # held, on nothing
    grip.pull(MOTION)
    assert wish(grip).motion is MOTION
    assert grip.pulling


def test_let_go_is_rest_at_once_and_what_comes_late_counts_for_nothing(grip):
    grip.beat()
    grip.pull(MOTION)
    grip.release()
    assert wish(grip) == MotionRequest()
    grip.pull(MOTION)
    assert wish(grip) == MotionRequest()
    grip.beat()
    assert wish(grip) == MotionRequest()  # a new press does not want what an old one wanted


def test_a_page_that_says_nothing_any_more_lets_the_robot_rest(grip, clock):
    grip.beat()
    grip.pull(MOTION)
    for _ in range(5):
        clock.time += 0.9 * FRESH
        assert wish(grip).motion is MOTION
        grip.beat()
    clock.time += FRESH
    assert wish(grip) == MotionRequest()
    assert not grip.pulling


def test_a_joint_is_pulled_from_where_all_were_when_it_was_taken(grip):
    grip.beat()
    grip.pull_joint(1, 0.7)
    assert wish(grip) == MotionRequest()  # it is not known yet where the robot is
    grip.pull_joint(1, 0.7)
    motion = wish(grip, HOME + 0.01).motion
    assert isinstance(motion, JointTarget)
    assert motion.q.tolist() == [0.1, 0.7, 0.3]
    grip.pull_joint(1, 0.8)
    assert wish(grip).motion.q.tolist() == [0.1, 0.8, 0.3]
    grip.release()
    wish(grip, HOME + 1.0)
    grip.beat()
    grip.pull_joint(0, 0.0)
    assert wish(grip).motion.q.tolist() == pytest.approx([0.0, 1.2, 1.3])


def test_who_ends_wants_nothing_any_more(grip):
    grip.beat()
    grip.pull(MOTION)
    grip.end("given back")
    grip.beat()
    assert wish(grip) == MotionRequest(ended="given back")
    grip.close()
