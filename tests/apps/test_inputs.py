"""Inputs without their devices: dead zone, keys, mailbox, speed share, plug-ins."""

import numpy as np
import pytest

from armgate.apps.errors import UsageError
from armgate.apps.lead.inputs import Setting, SpeedShare, find
from armgate.apps.lead.inputs.gamepad import DEAD_ZONE, beyond
from armgate.apps.lead.inputs.keyboard import HELD, Keys, keys_in
from armgate.apps.lead.inputs.mailbox import VALIDITY, Mailbox
from armgate.apps.lead.motions import JointRate, MotionRequest, RobotState, ToolTwist

STATE = RobotState(0.0, np.zeros(3), np.zeros(3))


@pytest.fixture
def lines():
    return []


@pytest.fixture
def keys(description, clock, lines):
    return Keys(Setting(description.robots[0], "joint", lines.append), clock)


def test_the_dead_zone_is_zero_and_values_rise_linearly_outside():
    assert [beyond(x) for x in (0.0, DEAD_ZONE, -DEAD_ZONE)] == [0.0, 0.0, 0.0]
    assert beyond(1.0) == -beyond(-32768 / 32767) == 1.0
    middle = (1.0 + DEAD_ZONE) / 2.0
    assert beyond(middle) == pytest.approx(0.5)
    assert beyond(-middle) == pytest.approx(-0.5)


def test_a_speed_share_is_halved_and_doubled_within_bounds(lines):
    pace = SpeedShare(lines.append)
    for _ in range(9):
        pace.slower()
    assert 0.0 < pace.share < 0.1
    for _ in range(9):
        pace.faster()
    assert pace.share == 1.0
    assert lines[-1] == "100% of the speed"


def test_terminal_input_is_read_as_keys():
    assert [*keys_in(b"w\x1b[A\x1bOB2\xc3")] == ["w", "+", "-", "2", "unknown"]
    assert [*keys_in(b"\x1b[5~")] == ["unknown"]


def test_a_key_moves_the_robot_for_a_limited_time(keys, clock):
    assert keys.request() == MotionRequest()
    keys.press("+")
    motion = keys.request().motion
    assert isinstance(motion, JointRate)
    assert motion.share.tolist() == [0.5, *[0.0] * (len(motion.share) - 1)]
    clock.time += HELD
    assert keys.request() == MotionRequest()


@pytest.mark.parametrize("key", [" ", "unknown", "x", "2", "m", "]"])
def test_every_other_key_brings_the_robot_to_rest(keys, key):
    keys.press("+")
    keys.press(key)
    assert keys.request().motion is None


def test_keys_choose_joints_modes_and_speeds(keys, lines):
    keys.press("2")
    keys.press("[")
    keys.press("-")
    assert keys.request().motion.share[1] == -0.25
    keys.press("9")  # there is no such joint
    keys.press("w")  # the tool's key
    assert keys.request().motion is None
    keys.press("m")
    assert lines[-1] == "moving the tool"
    keys.press("j")
    motion = keys.request().motion
    assert isinstance(motion, ToolTwist)
    assert motion.share.tolist() == [0, 0, 0, 0, 0, 0.25]
    keys.press("+")
    assert keys.request().motion is None
    keys.press("q")
    assert keys.request().ended == "ended by the keyboard"


def test_a_mailbox_holds_a_motion_for_its_validity(clock):
    box, motion = Mailbox(now=clock), JointRate(np.zeros(3))
    assert box.request(STATE) == MotionRequest()
    box.put(motion)
    assert box.request(STATE).motion is motion
    clock.time += VALIDITY
    assert box.request(STATE) == MotionRequest()
    box.put(motion)
    box.put(None)
    assert box.request(STATE) == MotionRequest()
    box.end("the page was closed", failed=True)
    box.put(motion)
    assert box.request(STATE) == MotionRequest(ended="the page was closed", failed=True)
    box.close()


def test_plug_ins_are_found_by_name():
    assert callable(find("gamepad"))
    with pytest.raises(UsageError, match="no input 'wheel'; there are gamepad, keyboard"):
        find("wheel")
