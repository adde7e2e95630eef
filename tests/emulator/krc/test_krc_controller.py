"""Tests of the virtual KRC as a whole, cycle by cycle, without time and sockets."""

import dataclasses
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from armgate.emulator.krc import PROFILES, Axis, Context, KrcError, Limits, Mode, kr16
from support.krcs import Desk, element, ipoc_of, sen, values_of

STEP = (0.05, 0.0, 0.0, 0.0, 0.0, 0.0)
PROFILE_NAMES = sorted(PROFILES)
GANTRY = (Axis("E1", True, -1000.0, 1000.0, 1000.0, 4000.0), Axis("E2", False, -180.0, 180.0, 90.0, 360.0))


def on_a_gantry():
    arm = kr16()
    return dataclasses.replace(arm, axes=(*arm.axes, *GANTRY), start=(*arm.start, 100.0, 30.0))


# --- start -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", PROFILE_NAMES)
def test_the_first_seconds_of_a_public_driver(name):
    """Send zeros, then a ramp: the axis follows, the programmed position stays, and no cycle is late."""
    desk = Desk(name)
    assert desk.state == "waiting"
    desk.answer(cycles=3)
    assert desk.state == "running"
    start = values_of(desk.telegram, "ASPos")
    for number in range(1, 401):
        desk.answer((0.002 * number, 0, 0, 0, 0, 0))
    desk.answer((0.8, 0, 0, 0, 0, 0), cycles=1000)
    assert values_of(desk.telegram, "ASPos") == start == list(kr16().start)
    assert values_of(desk.telegram, "AIPos") == pytest.approx([0.8, *start[1:]], abs=1e-4)
    assert (desk.delay, desk.state, desk.status["rejected"]) == (0, "running", {})


def test_rist_moves_and_rsol_stays():
    desk = Desk(sent=("DEF_RIst", "DEF_RSol"))
    desk.answer((0.1, 0, 0, 0, 0, 0), cycles=200)
    assert values_of(desk.telegram, "RSol") == pytest.approx((930, 0, 1162, 180, 0, 180), abs=1e-4)
    assert values_of(desk.telegram, "RIst")[1] == pytest.approx(-930 * math.sin(math.radians(0.1)), abs=1e-3)


def test_rsi_2_begins_with_a_short_frame_that_needs_no_answer():
    desk = Desk("krc2-rsi2")
    assert desk.telegram == b'<Rob TYPE="KUKA"><IPOC>100</IPOC></Rob>'
    assert len(desk.silent()) > 100
    assert (desk.delay, desk.state) == (0, "waiting")
    desk.silent()
    assert desk.delay == 1
    answered = Desk("krc2-rsi2")
    answered.answer()
    assert (answered.state, answered.delay) == ("running", 0)
    assert len(Desk("krc4-rsi3").telegram) > 100


@pytest.mark.parametrize(("name", "step"), [("krc2-rsi2", 1), ("krc4-rsi3", 4), ("krc5-rsi5", 4)])
def test_the_ipoc_has_a_random_start_and_the_step_of_the_controller(name, step):
    desk = Desk(name)
    seen = [int(ipoc_of(desk.telegram)), *(int(ipoc_of(desk.answer())) for _ in range(3))]
    assert seen == [100, 100 + step, 100 + 2 * step, 100 + 3 * step]
    assert int(ipoc_of(Desk("krc4-rsi3", ipoc=None, cycle=0.012).telegram)) > 1000
    twelve = Desk("krc4-rsi3", cycle=0.012)
    assert ipoc_of(twelve.answer()) == "112"


@pytest.mark.parametrize(("name", "bits"), [("krc2-rsi2", 32), ("krc4-rsi3", 64)])
def test_the_ipoc_wraps_while_the_robot_runs(name, bits):
    desk = Desk(name, ipoc=2**bits - 8)
    desk.answer(cycles=20)
    assert int(ipoc_of(desk.telegram)) < 100
    assert (desk.state, desk.delay) == ("running", 0)


def test_feedback_is_rounded_to_a_tenth_by_default():
    desk = Desk(context=Context())
    desk.answer((0.04, 0, 0, 0, 0, 0), cycles=200)
    assert values_of(desk.telegram, "AIPos")[0] == 0.0
    assert desk.status["measured"]["A1"] == pytest.approx(0.04, abs=1e-6)


@pytest.mark.parametrize("name", PROFILE_NAMES)
def test_the_measured_position_lags_by_the_profiles_time(name):
    desk = Desk(name)
    desk.answer((0.1, 0, 0, 0, 0, 0), cycles=2)
    cycles = 40
    desk.answer((0.1, 0, 0, 0, 0, 0), cycles=cycles)
    wanted = 0.1 * (1 - math.exp(-(cycles + 1) * desk.profile.cycle / desk.profile.lag))
    assert values_of(desk.telegram, "AIPos")[0] == pytest.approx(wanted, abs=2e-6)


def test_a_reply_affects_the_telegram_after_the_next():
    desk = Desk()
    desk.answer(STEP)
    assert values_of(desk.telegram, "AIPos")[0] == 0.0
    desk.answer(STEP)
    assert values_of(desk.telegram, "AIPos")[0] > 0.0


# --- invalid replies ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("spoil", "fault", "text"),
    [
        (lambda ipoc: sen(int(ipoc) + 1, STEP), "wrong_ipoc", "expected 104, echoed unchanged"),
        (lambda ipoc: sen("0" + ipoc, STEP), "wrong_ipoc", "IPOC 0104 was not sent"),
        (lambda ipoc: sen(int(ipoc) - 4, STEP), "late", "answers IPOC 100, 1 telegram(s) ago"),
        (lambda ipoc: sen(ipoc, STEP, sentype="Other"), "sentype", "SENTYPE 'ImFree'"),
        (lambda ipoc: sen(ipoc, STEP)[:-3], "xml", "not well-formed"),
        (lambda ipoc: b"\x00" * 65507, "xml", "65507 bytes; expected at most 1024"),
    ],
)  # fmt: skip
def test_an_invalid_reply_changes_only_the_delay(spoil, fault, text):
    desk = Desk()
    desk.answer()
    desk.get(spoil(ipoc_of(desk.telegram)))
    assert (desk.delay, desk.status["rejected"]) == (1, {fault: 1})
    assert desk.setpoint[0] == 0.0
    assert text in desk.log.texts("rejected")[0]
    desk.answer(STEP)
    assert desk.delay == 1
    assert desk.setpoint[0] == 0.05


@pytest.mark.parametrize(
    ("name", "age", "late"), [("krc2-rsi2", 0.0099, 0), ("krc2-rsi2", 0.0101, 1), ("krc4-rsi3", 0.0041, 1)]
)
def test_a_reply_is_accepted_until_the_time_of_the_controller(name, age, late):
    desk = Desk(name)
    desk.answer()
    desk.get(sen(ipoc_of(desk.telegram), STEP), age=age)
    assert desk.delay == late
    assert desk.setpoint[0] == (0.0 if late else 0.05)


def test_datagrams_of_other_senders_are_rejected():
    desk = Desk()
    desk.get(sen(100, STEP), stranger="10.0.0.9:7")
    assert desk.status["rejected"] == {"stranger": 1}
    assert "10.0.0.9:7" in desk.log.texts("rejected")[0]
    assert (desk.state, desk.delay) == ("waiting", 1)


def test_of_two_answers_the_first_counts():
    desk = Desk()
    desk.get(sen(100, STEP), sen(100, (0.01, 0, 0, 0, 0, 0)), sen(100, STEP))
    assert desk.setpoint[0] == 0.05
    assert (desk.delay, desk.status["rejected"]) == (0, {"double": 2})


def test_a_valid_reply_after_invalid_ones_counts():
    desk = Desk()
    desk.get(b"junk", sen(96, STEP), sen(100, STEP))
    assert (desk.setpoint[0], desk.delay) == (0.05, 0)


def test_repeated_events_are_logged_at_powers_of_two():
    desk = Desk(context=Context(timeout=10_000))
    for _ in range(1000):
        desk.get(b"junk")
    assert len(desk.log.texts("rejected")) == 10
    assert desk.status["rejected"] == {"xml": 1000}


@given(st.lists(st.binary(max_size=200), max_size=20))
def test_random_datagrams_neither_move_the_robot_nor_stop_the_controller(datagrams):
    desk = Desk()
    for data in datagrams:
        desk.get(data)
    assert desk.setpoint == list(kr16().start)
    assert desk.state == ("waiting" if len(datagrams) <= 10 else "broken_off")


# --- late replies ------------------------------------------------------------------------------------------


def test_one_lost_reply_is_held_and_counted():
    desk = Desk()
    desk.answer(STEP, cycles=2)
    desk.silent()
    assert (desk.setpoint[0], desk.delay, desk.state) == (0.05, 1, "running")
    assert values_of(desk.telegram, "Delay") == [1.0]
    desk.answer(STEP)
    assert desk.delay == 1


def test_without_holdon_a_lost_reply_is_a_jump_to_the_start():
    """Check the main cause of unstable robots: here a jump of 1 deg in a cycle, which is a drive fault."""
    desk = Desk(hold=0)
    for number in range(1, 21):
        desk.answer((0.05 * number, 0, 0, 0, 0, 0))
    assert desk.state == "running"
    desk.silent()
    assert desk.state == "faulted"
    assert desk.status["message"].startswith("Command velocity A1")


def test_timeout_counts_all_late_cycles_and_ends_the_run():
    desk = Desk()
    for _ in range(10):
        desk.answer(STEP)
        desk.silent()
    assert (desk.state, desk.delay) == ("running", 10)
    desk.answer(STEP)
    assert desk.silent() is None
    assert desk.state == "broken_off"
    assert desk.status["message"] == (
        "KSS29002 RSI: 11 late cycles since the start, Timeout is 10; the program stops"
    )
    assert desk.setpoint[0] == 0.05


def test_ten_late_cycles_in_a_row_are_tolerated_and_eleven_are_not():
    for profile in PROFILE_NAMES:
        desk = Desk(profile, context=Context(timeout=100 if profile == "krc2-rsi2" else 10))
        desk.answer()
        desk.silent(10)
        assert (desk.state, desk.delay) == ("running", 10)
        desk.answer()
        desk.silent(11)
        assert desk.state == "broken_off"


def test_a_pc_that_never_answers_ends_the_run():
    desk = Desk()
    desk.silent(10)
    assert desk.state == "waiting"
    assert desk.silent() is None
    assert desk.state == "broken_off"


def test_with_onlysend_replies_are_neither_expected_nor_read():
    desk = Desk(only_send="TRUE")
    desk.answer(STEP, cycles=30)
    desk.silent(30)
    assert (desk.state, desk.delay, desk.setpoint[0]) == ("waiting", 0, 0.0)


# --- correction -------------------------------------------------------------------------------------------


def test_in_relative_mode_a_lost_reply_repeats_the_last_correction():
    desk = Desk(context=Context(mode=Mode.RELATIVE, precision=6))
    desk.answer((0.01, 0, 0, 0, 0, 0), cycles=5)
    assert desk.setpoint[0] == pytest.approx(0.05)
    desk.silent(3)
    assert desk.setpoint[0] == pytest.approx(0.08)


def test_axiscorr_cuts_without_notice():
    desk = Desk()
    for number in range(1, 700):
        desk.answer((0.01 * number, 0, 0, 0, 0, 0))
    assert (desk.setpoint[0], desk.state) == (5.0, "running")
    assert [event for _, event, _, _ in desk.log] == ["waiting", "running"]


def test_axiscorrmon_stops_rsi():
    desk = Desk(context=Context(limits=Limits(170.0)))
    for number in range(1, 601):
        desk.answer((0.01 * number, 0, 0, 0, 0, 0))
    assert desk.state == "running"
    assert desk.answer((6.01, 0, 0, 0, 0, 0)) is None
    assert desk.state == "broken_off"
    assert desk.status["message"].startswith("KSS29000 RSI: A1 is corrected by 6.01, AXISCORRMON allows ±6")
    assert desk.setpoint[0] == 6.0


def test_a_step_that_is_too_large_is_a_drive_fault():
    desk = Desk()
    desk.answer()
    assert desk.answer((3.0, 0, 0, 0, 0, 0)) is None
    assert desk.state == "faulted"
    assert desk.status["message"].startswith("Command velocity A1: 750.0 deg/s; its drive allows 171.6")
    desk = Desk()
    desk.answer()
    desk.answer((0.5, 0, 0, 0, 0, 0))
    assert desk.status["message"].startswith("Command gear torque A1")


def test_wrong_tag_names_have_no_effect_and_are_logged():
    desk = Desk()
    desk.answer(STEP, cycles=5, tag="AKorr")
    assert (desk.state, desk.setpoint[0], desk.delay) == ("running", 0.0, 0)
    assert desk.log.texts("missing") == [
        "the reply lacks AK.A1, AK.A2, AK.A3, AK.A4, AK.A5, AK.A6, which RECEIVE declares: HOLDON"
    ]
    assert desk.log.texts("unknown")[0].startswith("the reply contains AKorr.A1, AKorr.A2")


def test_stop_and_message_from_the_pc():
    desk = Desk(more=element("Stop", 7, "BOOL", 0) + element("DEF_EStr", "INTERNAL", "STRING"))
    desk.answer(STEP, more="<EStr>mind the gap</EStr><Stop>0</Stop>")
    assert desk.log.texts("estr") == ["message from the PC: mind the gap"]
    assert desk.answer(STEP, more="<Stop>1</Stop>") is None
    assert (desk.state, desk.status["message"]) == ("stopped", "stopped by the sensor (Stop)")


# --- external axes ----------------------------------------------------------------------------------------

SIX_AND_TWO = (*(f"AK.A{n}" for n in range(1, 7)), "EK.E1", "EK.E2")


@pytest.mark.parametrize(
    ("name", "shown"), [("krc4-rsi3", 101.0), ("krc5-rsi5", 101.0), ("krc2-rsi2", 101.0 * 180 / math.pi)]
)
def test_external_axes_are_mm_to_the_krc_and_the_profiles_unit_from_it(name, shown):
    desk = Desk(name, arm=on_a_gantry(), received=SIX_AND_TWO, sent=("DEF_EIPos", "DEF_ESPos"))
    desk.silent()
    for number in range(1, 41):
        desk.answer(external=(0.025 * number, -0.0125 * number))
    desk.answer(external=(1.0, -0.5), cycles=1000)
    assert desk.setpoint[6:] == [101.0, 29.5]
    assert values_of(desk.telegram, "EIPos") == pytest.approx([shown, 29.5, 0, 0, 0, 0], abs=1e-3)
    assert values_of(desk.telegram, "ESPos")[0] == pytest.approx(shown * 100 / 101, abs=1e-3)


def test_correcting_missing_external_axes_fails_with_axiscorrext():
    for name in ("krc4-rsi3", "krc5-rsi5"):
        with pytest.raises(
            KrcError, match=f"EK.E1, EK.E2, but the robot has no such .* AXISCORREXT fails on {name}"
        ):
            Desk(name, received=SIX_AND_TWO)
    desk = Desk("krc2-rsi2", received=SIX_AND_TWO)
    desk.answer(external=(1.0, 2.0), cycles=3)
    assert desk.state == "running"


def test_currents_and_function_generators_are_sent_on_request():
    desk = Desk(sent=("DEF_MACur", "DEF_MECur", "DEF_Tech.C1"))
    desk.answer((0.001, 0, 0, 0, 0, 0), cycles=2)
    assert values_of(desk.telegram, "MACur")[0] != 0.0
    assert values_of(desk.telegram, "MECur") == [0.0] * 6
    assert len(values_of(desk.telegram, "Tech")) == 10


# --- pendant -----------------------------------------------------------------------------------------------


def test_an_estop_ends_the_run_and_the_next_one_starts_at_the_robots_position():
    desk = Desk()
    desk.answer((0.1, 0, 0, 0, 0, 0), cycles=100)
    assert desk.operate("estop") is None
    assert desk.get(sen(ipoc_of(desk.telegram), (0.11, 0, 0, 0, 0, 0))) is None
    assert desk.state == "estopped"
    assert "possible: estop, reset, restart" in desk.operate("start")
    assert desk.operate("reset") is None
    assert desk.silent() is None
    assert desk.operate("start") is None
    desk.silent()
    programmed = values_of(desk.telegram, "ASPos")
    assert programmed == values_of(desk.telegram, "AIPos")
    assert programmed[0] == pytest.approx(0.1, abs=1e-4)
    desk.answer(cycles=50)
    assert values_of(desk.telegram, "AIPos")[0] == pytest.approx(programmed[0], abs=1e-5)
    assert (desk.state, desk.delay) == ("running", 0)


def test_a_paused_krc_is_silent_and_keeps_its_correction():
    desk = Desk()
    desk.answer(STEP, cycles=5)
    before = int(ipoc_of(desk.telegram))
    desk.operate("pause")
    assert desk.silent(50) is None
    desk.operate("resume")
    desk.silent()
    assert desk.state == "waiting"
    assert int(ipoc_of(desk.telegram)) == before + 4 * 51
    assert (desk.setpoint[0], desk.delay) == (0.05, 0)
    desk.answer(STEP)
    assert desk.state == "running"


def test_counters_stand_still_in_a_pause():
    desk = Desk("krc2-rsi2")
    desk.answer(cycles=5)
    before = int(ipoc_of(desk.telegram))
    desk.operate("pause")
    desk.silent(50)
    desk.operate("resume")
    desk.silent()
    assert int(ipoc_of(desk.telegram)) == before + 1


@pytest.mark.parametrize("name", PROFILE_NAMES)
def test_a_restart_in_motion_resets_everything_but_the_position(name):
    desk = Desk(name)
    desk.silent(3)
    desk.answer(STEP, cycles=5)
    measured = desk.status["measured"]["A1"]
    old = ipoc_of(desk.telegram)
    desk.operate("restart")
    desk.get(sen(old, STEP))
    assert (desk.state, desk.delay, desk.status["rejected"]) == ("waiting", 0, {})
    assert ipoc_of(desk.telegram) != old
    assert (len(desk.telegram) < 100) is desk.profile.short_first
    assert desk.status["programmed"]["A1"] == pytest.approx(measured)
    desk.answer()
    assert desk.state == "running"


def test_jogging_is_possible_only_while_no_program_runs():
    desk = Desk()
    desk.answer()
    assert "no jogging while running" in desk.controller.jog("A1", 5.0)
    desk.operate("pause")
    assert "there is no axis 'E1'" in desk.controller.jog("E1", 5.0)
    assert desk.controller.jog("A2", 5.0) is None
    desk.operate("resume")
    desk.silent()
    assert values_of(desk.telegram, "AIPos")[1] == pytest.approx(-85.0, abs=1e-5)
    assert values_of(desk.telegram, "ASPos")[1] == -90.0


def test_the_ipoc_can_jump():
    desk = Desk()
    desk.controller.jump_ipoc(7)
    desk.answer()
    assert ipoc_of(desk.telegram) == "7"
    desk.answer()
    assert (ipoc_of(desk.telegram), desk.delay) == ("11", 0)


def test_controllers_with_equal_seeds_behave_equally():
    one, other = Desk(ipoc=None), Desk(ipoc=None)
    assert [one.answer(STEP) for _ in range(20)] == [other.answer(STEP) for _ in range(20)]
