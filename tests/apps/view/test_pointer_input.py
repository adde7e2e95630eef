"""Requests of a page's pointer: motion only while it is held down."""

import numpy as np
import pytest

from armgate.apps.lead.motions import JointRate, JointTarget, MotionRequest, RobotState
from armgate.apps.view.pointer_input import HOLD_TIMEOUT, PointerInput

HOME = np.array([0.1, 0.2, 0.3])
MOTION = JointRate(np.ones(3))


@pytest.fixture
def pointer(clock):
    return PointerInput(clock)


def requested(pointer, setpoint=HOME):
    return pointer.request(RobotState(0.0, setpoint, setpoint))


def test_no_motion_is_requested_unless_the_pointer_is_held(pointer):
    assert requested(pointer) == MotionRequest()
    pointer.move_to(MOTION)
    assert requested(pointer) == MotionRequest()
    assert not pointer.moving
    pointer.hold()
    assert requested(pointer) == MotionRequest()  # held, but not on a handle
    pointer.move_to(MOTION)
    assert requested(pointer).motion is MOTION
    assert pointer.moving


def test_a_release_ends_the_motion_at_once_and_late_motions_are_ignored(pointer):
    pointer.hold()
    pointer.move_to(MOTION)
    pointer.release()
    assert requested(pointer) == MotionRequest()
    pointer.move_to(MOTION)
    assert requested(pointer) == MotionRequest()
    pointer.hold()
    assert requested(pointer) == MotionRequest()  # a new press does not repeat the old motion


def test_a_silent_page_brings_the_robot_to_rest(pointer, clock):
    pointer.hold()
    pointer.move_to(MOTION)
    for _ in range(5):
        clock.time += 0.9 * HOLD_TIMEOUT
        assert requested(pointer).motion is MOTION
        pointer.hold()
    clock.time += HOLD_TIMEOUT
    assert requested(pointer) == MotionRequest()
    assert not pointer.moving


def test_a_joint_moves_from_the_positions_at_the_start_of_the_drag(pointer):
    pointer.hold()
    pointer.move_joint(1, 0.7)
    assert requested(pointer) == MotionRequest()  # the robot's position is not known yet
    pointer.move_joint(1, 0.7)
    motion = requested(pointer, HOME + 0.01).motion
    assert isinstance(motion, JointTarget)
    assert motion.q.tolist() == [0.1, 0.7, 0.3]
    pointer.move_joint(1, 0.8)
    assert requested(pointer).motion.q.tolist() == [0.1, 0.8, 0.3]
    pointer.release()
    requested(pointer, HOME + 1.0)
    pointer.hold()
    pointer.move_joint(0, 0.0)
    assert requested(pointer).motion.q.tolist() == pytest.approx([0.0, 1.2, 1.3])


def test_an_ended_input_requests_no_motion(pointer):
    pointer.hold()
    pointer.move_to(MOTION)
    pointer.end("released")
    pointer.hold()
    assert requested(pointer) == MotionRequest(ended="released")
    pointer.close()
