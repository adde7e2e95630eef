"""When a page that drives wants something of its robot."""

import numpy as np
import pytest

from armgate.apps.lead.motions import JointRate, JointTarget, MotionRequest, RobotState
from armgate.apps.view.pointer_input import HOLD_TIMEOUT, PointerInput

HOME = np.array([0.1, 0.2, 0.3])
MOTION = JointRate(np.ones(3))


@pytest.fixture
def pointer(clock):
    return PointerInput(clock)


def wish(pointer, setpoint=HOME):
    return pointer.request(RobotState(0.0, setpoint, setpoint))


def test_no_motion_is_requested_unless_the_pointer_is_held(pointer):
    assert wish(pointer) == MotionRequest()
    pointer.move_to(MOTION)
    assert wish(pointer) == MotionRequest()
    assert not pointer.moving
    pointer.hold()
    assert wish(pointer) == MotionRequest()  # held, on nothing
    pointer.move_to(MOTION)
    assert wish(pointer).motion is MOTION
    assert pointer.moving


def test_a_release_rests_at_once_and_late_motions_are_ignored(pointer):
    pointer.hold()
    pointer.move_to(MOTION)
    pointer.release()
    assert wish(pointer) == MotionRequest()
    pointer.move_to(MOTION)
    assert wish(pointer) == MotionRequest()
    pointer.hold()
    assert wish(pointer) == MotionRequest()  # a new press does not want what an old one wanted


def test_a_silent_page_brings_the_robot_to_rest(pointer, clock):
    pointer.hold()
    pointer.move_to(MOTION)
    for _ in range(5):
        clock.time += 0.9 * HOLD_TIMEOUT
        assert wish(pointer).motion is MOTION
        pointer.hold()
    clock.time += HOLD_TIMEOUT
    assert wish(pointer) == MotionRequest()
    assert not pointer.moving


def test_a_joint_moves_from_the_positions_at_the_start_of_the_drag(pointer):
    pointer.hold()
    pointer.move_joint(1, 0.7)
    assert wish(pointer) == MotionRequest()  # it is not known yet where the robot is
    pointer.move_joint(1, 0.7)
    motion = wish(pointer, HOME + 0.01).motion
    assert isinstance(motion, JointTarget)
    assert motion.q.tolist() == [0.1, 0.7, 0.3]
    pointer.move_joint(1, 0.8)
    assert wish(pointer).motion.q.tolist() == [0.1, 0.8, 0.3]
    pointer.release()
    wish(pointer, HOME + 1.0)
    pointer.hold()
    pointer.move_joint(0, 0.0)
    assert wish(pointer).motion.q.tolist() == pytest.approx([0.0, 1.2, 1.3])


def test_an_ended_input_requests_no_motion(pointer):
    pointer.hold()
    pointer.move_to(MOTION)
    pointer.end("released")
    pointer.hold()
    assert wish(pointer) == MotionRequest(ended="released")
    pointer.close()
