"""Tests of single rules: states, IPOC, Delay, HOLDON, AXISCORR, drives and profiles."""

import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from armgate.emulator.krc import PROFILES, Context, Event, KrcError, Limits, Mode, State, kr16, profile_named
from armgate.emulator.krc.robot.correction import Correction
from armgate.emulator.krc.robot.drives import Drives
from armgate.emulator.krc.rsi.delay import DelayCounter
from armgate.emulator.krc.rsi.ethernet import A_AXES
from armgate.emulator.krc.rsi.ipoc import Ipoc
from armgate.emulator.krc.rsi.received_values import ReceivedValues
from armgate.emulator.krc.states import ACTIVE, next_state
from support.krcs import element, ethernet

# --- states: all pairs -----------------------------------------------------------------------------

FAULTS = {State.BROKEN_OFF, State.FAULTED, State.ESTOPPED}


@pytest.mark.parametrize(("state", "event"), list(itertools.product(State, Event)))
def test_every_pair_of_state_and_event_has_the_expected_result(state, event):
    if event is Event.RESTART:
        wanted = State.WAITING
    elif event is Event.ESTOP:
        wanted = State.ESTOPPED
    elif event is Event.RESET:
        wanted = State.STOPPED if state in FAULTS else None
    elif event is Event.START:
        wanted = State.WAITING if state is State.STOPPED else None
    elif event is Event.RESUME:
        wanted = State.WAITING if state is State.PAUSED else None
    elif event is Event.STOP:
        wanted = State.STOPPED if state in ACTIVE | {State.PAUSED} else None
    else:
        ends = {
            Event.ANSWERED: State.RUNNING, Event.TIMEOUT: State.BROKEN_OFF, Event.MONITOR: State.BROKEN_OFF,
            Event.DRIVE: State.FAULTED, Event.SENSOR_STOP: State.STOPPED, Event.PAUSE: State.PAUSED,
        }  # fmt: skip
        wanted = ends[event] if state in ACTIVE else None
    assert next_state(state, event) is wanted


def test_only_the_pendant_leads_from_a_fault_to_motion():
    """Check that only a restart, or a reset and a start, end a fault; all are events at the pendant."""
    for state, event in itertools.product(FAULTS, Event):
        assert next_state(state, event) not in ACTIVE or event is Event.RESTART


# --- IPOC -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("bits", "step"), [(32, 1), (64, 4), (64, 12)])
def test_the_ipoc_wraps(bits, step):
    ipoc = Ipoc((1 << bits) - step, step, bits)
    assert [ipoc.send(), ipoc.send(), ipoc.send()] == [(1 << bits) - step, 0, step]
    assert ipoc.last == step


def test_the_ipoc_remembers_the_numbers_sent():
    ipoc = Ipoc(10, 4, 64)
    assert ipoc.last is None
    assert ipoc.age("10") is None
    for _ in range(3):
        ipoc.send()
    assert [ipoc.age(text) for text in ("18", "14", "10", "22", "018")] == [0, 1, 2, None, None]


# --- Delay ------------------------------------------------------------------------------------------------


def test_all_late_cycles_count_not_only_consecutive_ones():
    delay = DelayCounter(3, None, 1.0)
    for _ in range(3):
        assert delay.add(True) is None
        assert delay.add(False) is None
    assert delay.add(True) == "4 late cycles since the start exceed Timeout 3"
    assert delay.count == 4


def test_krc2_tolerates_ten_late_cycles_in_a_row():
    delay = DelayCounter(1000, 10, 1.0)
    assert [delay.add(True) for _ in range(10)] == [None] * 10
    assert delay.add(False) is None
    for _ in range(10):
        assert delay.add(True) is None
    assert delay.add(True) == "11 late cycles in a row exceed the limit of this controller, 10"


def test_krc2_tolerates_up_to_a_quarter_of_late_cycles():
    delay = DelayCounter(1000, 10, 0.25)
    found = [delay.add(number % 3 == 0) for number in range(100)]
    assert found[:99] == [None] * 99
    assert found[99] == "34 of the last 100 cycles were late"
    delay = DelayCounter(1000, 10, 0.25)
    assert {delay.add(number % 4 == 0) for number in range(400)} == {None}


# --- HOLDON -----------------------------------------------------------------------------------------------


def test_holdon_applies_to_each_element():
    file = ethernet(
        received=("AK.A1",), hold=1, more=element("AK.A2", 2, hold=0) + element("Stop", 3, "BOOL", 0)
    )
    one, two, stop = file.received
    received = ReceivedValues(file.received)
    assert received.number(one) == 0.0
    assert received.update({one: 1.5, two: 2.5, stop: True}) == ()
    assert received.named("Stop") is True
    assert received.update({}) == ("AK.A1", "AK.A2", "Stop")
    assert (received.number(one), received.number(two), received.named("Stop")) == (1.5, 0.0, False)
    assert received.number(None) == 0.0
    assert received.named("nothing") is None


# --- AXISCORR ---------------------------------------------------------------------------------------------


def test_absolute_values_are_the_whole_offset_and_relative_values_add_up():
    absolute = Correction(("A1", "E1"), Context())
    relative = Correction(("A1", "E1"), Context(mode=Mode.RELATIVE))
    for _ in range(3):
        assert absolute.apply((0.5, -1.0)) is None
        assert relative.apply((0.5, -1.0)) is None
    assert absolute.offset == (0.5, -1.0)
    assert relative.offset == (1.5, -3.0)


@pytest.mark.parametrize("mode", Mode)
def test_axiscorr_cuts_without_notice_at_five(mode):
    correction = Correction(A_AXES, Context(mode=mode))
    for _ in range(4):
        assert correction.apply((-7.0, 2.0, 0.0, 0.0, 0.0, 0.0)) is None
    assert correction.offset[0] == -5.0
    assert correction.offset[1] == (2.0 if mode is Mode.ABSOLUTE else 5.0)


def test_axiscorrmon_stops_at_six_even_if_axiscorr_is_wider():
    correction = Correction(A_AXES, Context(limits=Limits(170.0)))
    assert correction.apply((0.0, 6.0, 0.0, 0.0, 0.0, 0.0)) is None
    assert (
        correction.apply((0.0, -6.01, 0.0, 0.0, 0.0, 0.0))
        == "A2 is corrected by -6.01, AXISCORRMON allows ±6"
    )


def test_limits_are_read_by_group_and_axis():
    limits = Limits.from_text("A=170, E=2000,A6=350", 5.0)
    assert [limits[axis] for axis in ("A1", "A6", "E3")] == [170.0, 350.0, 2000.0]
    assert Limits.from_text("E1=10", 5.0)["A1"] == 5.0
    assert Limits.from_text("12", 5.0)["E6"] == 12.0


@pytest.mark.parametrize("text", ["", "A", "A7=3", "A=", "A=x", "0", "-5", "inf", "nan", "A=1,,E=2"])
def test_invalid_limits_are_refused(text):
    with pytest.raises(KrcError, match="expected a number above 0"):
        Limits.from_text(text, 5.0)


# --- drives -----------------------------------------------------------------------------------------------

PROFILE_NAMES = sorted(PROFILES)
ARM = kr16()


def drives(profile, at=ARM.start):
    return Drives(ARM.axes, profile.tolerance, profile.cycle, at)


def moved(index, by, at=ARM.start):
    return tuple(q + (by if k == index else 0.0) for k, q in enumerate(at))


@pytest.mark.parametrize("name", PROFILE_NAMES)
@given(data=st.data())
def test_motion_within_speed_and_acceleration_of_the_axes_never_faults(name, data):
    """Draw any acceleration and speed up to the axis's own in each cycle."""
    profile = PROFILES[name]
    index = data.draw(st.integers(0, 5))
    axis, T = ARM.axes[index], profile.cycle
    arm = drives(profile, tuple(0.5 * (one.lower + one.upper) for one in ARM.axes))
    q, v = arm.setpoint[index], 0.0
    for push in data.draw(st.lists(st.floats(-1.0, 1.0) | st.sampled_from([-1.0, 1.0]), max_size=60)):
        v = min(max(v + push * axis.acceleration * T, -axis.speed), axis.speed)
        if not axis.lower < q + v * T < axis.upper:
            break
        q += v * T
        assert arm.move([q if k == index else one for k, one in enumerate(arm.setpoint)]) is None


@pytest.mark.parametrize("name", PROFILE_NAMES)
@pytest.mark.parametrize("index", range(6))
def test_a_step_beyond_the_velocity_tolerance_is_a_command_velocity_fault(name, index):
    profile, axis = PROFILES[name], ARM.axes[index]
    largest = profile.tolerance.velocity * axis.speed * profile.cycle
    arm = drives(profile)
    found = arm.move(moved(index, -1.001 * largest))
    assert found.startswith(f"Command velocity {axis.name}: -")
    assert arm.setpoint == ARM.start


@pytest.mark.parametrize("name", PROFILE_NAMES)
@pytest.mark.parametrize(("share", "faults"), [(0.99, False), (1.01, True)])
def test_a_hold_of_one_cycle_is_tolerated_up_to_the_step_of_the_profile(name, share, faults):
    profile, axis = PROFILES[name], ARM.axes[0]
    speed = share * profile.tolerance.step(axis.acceleration, profile.cycle)
    assert speed < axis.speed
    arm, q = drives(profile), ARM.start
    for number in range(1, 100):
        q = moved(0, min(speed, number * axis.acceleration * profile.cycle) * profile.cycle, q)
        assert arm.move(q) is None
    found = arm.move(q)
    assert (found is not None) is faults
    assert not faults or found.startswith("Command gear torque A1")


@pytest.mark.parametrize(
    ("name", "cycle", "share"), [("krc2-rsi2", 0.012, 37), ("krc4-rsi3", 0.004, 26), ("krc4-rsi3", 0.012, 29)]
)
def test_the_documented_share_of_the_speed_agrees_with_the_profile(name, cycle, share):
    profile, axis = PROFILES[name].in_cycle(cycle), ARM.axes[0]
    assert round(100 * profile.tolerance.step(axis.acceleration, cycle) / axis.speed) == share


def test_the_filter_tolerates_a_short_acceleration():
    """Check that the same acceleration for a longer time is a fault."""
    profile, axis = PROFILES["krc4-rsi3"], ARM.axes[0]
    arm, q, v, found = drives(profile), ARM.start, 0.0, []
    for _ in range(40):
        v += 2.2 * axis.acceleration * profile.cycle
        q = moved(0, v * profile.cycle, q)
        found.append(arm.move(q))
        if found[-1]:
            break
    assert len(found) > 5
    assert found[-1].startswith("Command gear torque A1")
    assert max(arm.load) == pytest.approx(2.0, rel=0.1)


def test_an_axis_outside_its_range_may_move_back_but_not_further_out():
    profile = PROFILES["krc4-rsi3"]
    arm = drives(profile, moved(1, 126.0))  # A2 at 36 deg; its range ends at 35
    assert arm.move(moved(1, 125.99)) is None
    assert arm.move(moved(1, 126.0)).startswith("Software limit switch A2: 36.000 deg")


def test_rest_resets_the_filter_of_the_drives():
    arm = drives(PROFILES["krc4-rsi3"])
    arm.move(moved(0, 0.01))
    arm.rest(ARM.start)
    assert arm.load == (0.0,) * 6
    assert arm.move(ARM.start) is None


# --- profiles ---------------------------------------------------------------------------------------------


def test_profiles_have_the_figures_of_their_controllers():
    krc2, krc4, krc5 = (profile_named(name) for name in ("krc2-rsi2", "krc4-rsi3", "krc5-rsi5"))
    assert (krc2.cycle, krc2.ipoc_step, krc2.lag, krc2.short_first) == (0.012, 1, 0.12, True)
    assert krc2.linear_sent == pytest.approx(57.29578)
    for krc in (krc4, krc5):
        assert (krc.cycle, krc.ipoc_step, krc.lag, krc.short_first) == (0.004, 4, 0.03, False)
        assert krc.linear_sent == 1.0
    assert all(profile.reply_within <= profile.cycle for profile in PROFILES.values())


def test_the_ipo_cycle_is_twelve_ms():
    slow = PROFILES["krc4-rsi3"].in_cycle(0.012)
    assert (slow.cycle, slow.ipoc_step) == (0.012, 12)
    assert math.isclose(slow.reply_within, 0.012)
    with pytest.raises(KrcError, match="krc2-rsi2 has no cycle of 4 ms; expected 12 ms"):
        PROFILES["krc2-rsi2"].in_cycle(0.004)


def test_an_unknown_profile_is_refused_with_the_known_ones():
    with pytest.raises(KrcError, match="krc2-rsi2, krc4-rsi3, krc5-rsi5"):
        profile_named("krc3")
