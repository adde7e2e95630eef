"""Tests of the whole virtual KRC, cycle by cycle, without real time and sockets."""

import dataclasses
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from armgate.emulator.krc import PROFILES, Axis, Context, KrcError, Limits, Mode, kr16
from support.krcs import ControllerRig, element, ipoc_of, sen, values_of

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
    rig = ControllerRig(name)
    assert rig.state == "waiting"
    rig.answer(cycles=3)
    assert rig.state == "running"
    start = values_of(rig.telegram, "ASPos")
    for number in range(1, 401):
        rig.answer((0.002 * number, 0, 0, 0, 0, 0))
    rig.answer((0.8, 0, 0, 0, 0, 0), cycles=1000)
    assert values_of(rig.telegram, "ASPos") == start == list(kr16().start)
    assert values_of(rig.telegram, "AIPos") == pytest.approx([0.8, *start[1:]], abs=1e-4)
    assert (rig.delay, rig.state, rig.status["rejected"]) == (0, "running", {})


def test_rist_moves_and_rsol_stays():
    rig = ControllerRig(sent=("DEF_RIst", "DEF_RSol"))
    rig.answer((0.1, 0, 0, 0, 0, 0), cycles=200)
    assert values_of(rig.telegram, "RSol") == pytest.approx((930, 0, 1162, 180, 0, 180), abs=1e-4)
    assert values_of(rig.telegram, "RIst")[1] == pytest.approx(-930 * math.sin(math.radians(0.1)), abs=1e-3)


def test_rsi_2_begins_with_a_short_frame_that_needs_no_answer():
    rig = ControllerRig("krc2-rsi2")
    assert rig.telegram == b'<Rob TYPE="KUKA"><IPOC>100</IPOC></Rob>'
    assert len(rig.silent()) > 100
    assert (rig.delay, rig.state) == (0, "waiting")
    rig.silent()
    assert rig.delay == 1
    answered = ControllerRig("krc2-rsi2")
    answered.answer()
    assert (answered.state, answered.delay) == ("running", 0)
    assert len(ControllerRig("krc4-rsi3").telegram) > 100


@pytest.mark.parametrize(("name", "step"), [("krc2-rsi2", 1), ("krc4-rsi3", 4), ("krc5-rsi5", 4)])
def test_the_ipoc_has_a_random_start_and_the_step_of_the_controller(name, step):
    rig = ControllerRig(name)
    seen = [int(ipoc_of(rig.telegram)), *(int(ipoc_of(rig.answer())) for _ in range(3))]
    assert seen == [100, 100 + step, 100 + 2 * step, 100 + 3 * step]
    assert int(ipoc_of(ControllerRig("krc4-rsi3", ipoc=None, cycle=0.012).telegram)) > 1000
    twelve = ControllerRig("krc4-rsi3", cycle=0.012)
    assert ipoc_of(twelve.answer()) == "112"


@pytest.mark.parametrize(("name", "bits"), [("krc2-rsi2", 32), ("krc4-rsi3", 64)])
def test_the_ipoc_wraps_while_the_robot_runs(name, bits):
    rig = ControllerRig(name, ipoc=2**bits - 8)
    rig.answer(cycles=20)
    assert int(ipoc_of(rig.telegram)) < 100
    assert (rig.state, rig.delay) == ("running", 0)


def test_feedback_is_rounded_to_a_tenth_by_default():
    rig = ControllerRig(context=Context())
    rig.answer((0.04, 0, 0, 0, 0, 0), cycles=200)
    assert values_of(rig.telegram, "AIPos")[0] == 0.0
    assert rig.status["measured"]["A1"] == pytest.approx(0.04, abs=1e-6)


@pytest.mark.parametrize("name", PROFILE_NAMES)
def test_the_measured_position_lags_by_the_profiles_time(name):
    rig = ControllerRig(name)
    rig.answer((0.1, 0, 0, 0, 0, 0), cycles=2)
    cycles = 40
    rig.answer((0.1, 0, 0, 0, 0, 0), cycles=cycles)
    wanted = 0.1 * (1 - math.exp(-(cycles + 1) * rig.profile.cycle / rig.profile.lag))
    assert values_of(rig.telegram, "AIPos")[0] == pytest.approx(wanted, abs=2e-6)


def test_a_reply_affects_the_telegram_after_the_next():
    rig = ControllerRig()
    rig.answer(STEP)
    assert values_of(rig.telegram, "AIPos")[0] == 0.0
    rig.answer(STEP)
    assert values_of(rig.telegram, "AIPos")[0] > 0.0


# --- invalid replies ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("spoil", "fault", "text"),
    [
        (lambda ipoc: sen(int(ipoc) + 1, STEP), "wrong_ipoc", "expected 104, echoed unchanged"),
        (lambda ipoc: sen("0" + ipoc, STEP), "wrong_ipoc", "IPOC 0104 was not sent"),
        (lambda ipoc: sen(int(ipoc) - 4, STEP), "late", "replies to IPOC 100, 1 telegram(s) ago"),
        (lambda ipoc: sen(ipoc, STEP, sentype="Other"), "sentype", "SENTYPE 'ImFree'"),
        (lambda ipoc: sen(ipoc, STEP)[:-3], "xml", "not well-formed"),
        (lambda ipoc: b"\x00" * 65507, "xml", "65507 bytes; expected at most 1024"),
    ],
)  # fmt: skip
def test_an_invalid_reply_changes_only_the_delay(spoil, fault, text):
    rig = ControllerRig()
    rig.answer()
    rig.get(spoil(ipoc_of(rig.telegram)))
    assert (rig.delay, rig.status["rejected"]) == (1, {fault: 1})
    assert rig.setpoint[0] == 0.0
    assert text in rig.log.texts("rejected")[0]
    rig.answer(STEP)
    assert rig.delay == 1
    assert rig.setpoint[0] == 0.05


@pytest.mark.parametrize(
    ("name", "age", "late"), [("krc2-rsi2", 0.0099, 0), ("krc2-rsi2", 0.0101, 1), ("krc4-rsi3", 0.0041, 1)]
)
def test_a_reply_is_accepted_until_the_time_of_the_controller(name, age, late):
    rig = ControllerRig(name)
    rig.answer()
    rig.get(sen(ipoc_of(rig.telegram), STEP), age=age)
    assert rig.delay == late
    assert rig.setpoint[0] == (0.0 if late else 0.05)


def test_datagrams_of_other_senders_are_rejected():
    rig = ControllerRig()
    rig.get(sen(100, STEP), stranger="10.0.0.9:7")
    assert rig.status["rejected"] == {"stranger": 1}
    assert "10.0.0.9:7" in rig.log.texts("rejected")[0]
    assert (rig.state, rig.delay) == ("waiting", 1)


def test_the_first_of_two_replies_is_used():
    rig = ControllerRig()
    rig.get(sen(100, STEP), sen(100, (0.01, 0, 0, 0, 0, 0)), sen(100, STEP))
    assert rig.setpoint[0] == 0.05
    assert (rig.delay, rig.status["rejected"]) == (0, {"double": 2})


def test_a_valid_reply_after_invalid_ones_counts():
    rig = ControllerRig()
    rig.get(b"junk", sen(96, STEP), sen(100, STEP))
    assert (rig.setpoint[0], rig.delay) == (0.05, 0)


def test_repeated_events_are_logged_at_powers_of_two():
    rig = ControllerRig(context=Context(timeout=10_000))
    for _ in range(1000):
        rig.get(b"junk")
    assert len(rig.log.texts("rejected")) == 10
    assert rig.status["rejected"] == {"xml": 1000}


@given(st.lists(st.binary(max_size=200), max_size=20))
def test_random_datagrams_neither_move_the_robot_nor_stop_the_controller(datagrams):
    rig = ControllerRig()
    for data in datagrams:
        rig.get(data)
    assert rig.setpoint == list(kr16().start)
    assert rig.state == ("waiting" if len(datagrams) <= 10 else "broken_off")


# --- late replies ------------------------------------------------------------------------------------------


def test_after_one_lost_reply_the_setpoint_is_held_and_the_cycle_is_counted_as_late():
    rig = ControllerRig()
    rig.answer(STEP, cycles=2)
    rig.silent()
    assert (rig.setpoint[0], rig.delay, rig.state) == (0.05, 1, "running")
    assert values_of(rig.telegram, "Delay") == [1.0]
    rig.answer(STEP)
    assert rig.delay == 1


def test_without_holdon_a_lost_reply_is_a_jump_to_the_start():
    """Check the main cause of unstable robots: here a jump of 1 deg in a cycle, which is a drive fault."""
    rig = ControllerRig(hold=0)
    for number in range(1, 21):
        rig.answer((0.05 * number, 0, 0, 0, 0, 0))
    assert rig.state == "running"
    rig.silent()
    assert rig.state == "faulted"
    assert rig.status["message"].startswith("Command velocity A1")


def test_timeout_counts_all_late_cycles_and_ends_the_run():
    rig = ControllerRig()
    for _ in range(10):
        rig.answer(STEP)
        rig.silent()
    assert (rig.state, rig.delay) == ("running", 10)
    rig.answer(STEP)
    assert rig.silent() is None
    assert rig.state == "broken_off"
    assert rig.status["message"] == (
        "KSS29002 RSI: 11 late cycles since the start exceed Timeout 10; the program stops"
    )
    assert rig.setpoint[0] == 0.05


def test_ten_late_cycles_in_a_row_are_tolerated_and_eleven_are_not():
    for profile in PROFILE_NAMES:
        rig = ControllerRig(profile, context=Context(timeout=100 if profile == "krc2-rsi2" else 10))
        rig.answer()
        rig.silent(10)
        assert (rig.state, rig.delay) == ("running", 10)
        rig.answer()
        rig.silent(11)
        assert rig.state == "broken_off"


def test_a_pc_that_never_answers_ends_the_run():
    rig = ControllerRig()
    rig.silent(10)
    assert rig.state == "waiting"
    assert rig.silent() is None
    assert rig.state == "broken_off"


def test_with_onlysend_replies_are_neither_expected_nor_read():
    rig = ControllerRig(only_send="TRUE")
    rig.answer(STEP, cycles=30)
    rig.silent(30)
    assert (rig.state, rig.delay, rig.setpoint[0]) == ("waiting", 0, 0.0)


# --- correction -------------------------------------------------------------------------------------------


def test_in_relative_mode_a_lost_reply_repeats_the_last_correction():
    rig = ControllerRig(context=Context(mode=Mode.RELATIVE, precision=6))
    rig.answer((0.01, 0, 0, 0, 0, 0), cycles=5)
    assert rig.setpoint[0] == pytest.approx(0.05)
    rig.silent(3)
    assert rig.setpoint[0] == pytest.approx(0.08)


def test_axiscorr_cuts_without_notice():
    rig = ControllerRig()
    for number in range(1, 700):
        rig.answer((0.01 * number, 0, 0, 0, 0, 0))
    assert (rig.setpoint[0], rig.state) == (5.0, "running")
    assert [event for _, event, _, _ in rig.log] == ["waiting", "running"]


def test_axiscorrmon_stops_rsi():
    rig = ControllerRig(context=Context(limits=Limits(170.0)))
    for number in range(1, 601):
        rig.answer((0.01 * number, 0, 0, 0, 0, 0))
    assert rig.state == "running"
    assert rig.answer((6.01, 0, 0, 0, 0, 0)) is None
    assert rig.state == "broken_off"
    assert rig.status["message"].startswith("KSS29000 RSI: A1 is corrected by 6.01, AXISCORRMON allows ±6")
    assert rig.setpoint[0] == 6.0


def test_a_step_that_is_too_large_is_a_drive_fault():
    rig = ControllerRig()
    rig.answer()
    assert rig.answer((3.0, 0, 0, 0, 0, 0)) is None
    assert rig.state == "faulted"
    assert rig.status["message"].startswith("Command velocity A1: 750.0 deg/s; its drive allows 171.6")
    rig = ControllerRig()
    rig.answer()
    rig.answer((0.5, 0, 0, 0, 0, 0))
    assert rig.status["message"].startswith("Command gear torque A1")


def test_wrong_tag_names_have_no_effect_and_are_logged():
    rig = ControllerRig()
    rig.answer(STEP, cycles=5, tag="AKorr")
    assert (rig.state, rig.setpoint[0], rig.delay) == ("running", 0.0, 0)
    assert rig.log.texts("missing") == [
        "the reply lacks AK.A1, AK.A2, AK.A3, AK.A4, AK.A5, AK.A6, which RECEIVE declares: HOLDON"
    ]
    assert rig.log.texts("unknown")[0].startswith("the reply contains AKorr.A1, AKorr.A2")


def test_stop_and_message_from_the_pc():
    rig = ControllerRig(more=element("Stop", 7, "BOOL", 0) + element("DEF_EStr", "INTERNAL", "STRING"))
    rig.answer(STEP, more="<EStr>mind the gap</EStr><Stop>0</Stop>")
    assert rig.log.texts("estr") == ["message from the PC: mind the gap"]
    assert rig.answer(STEP, more="<Stop>1</Stop>") is None
    assert (rig.state, rig.status["message"]) == ("stopped", "stopped by the sensor (Stop)")


# --- external axes ----------------------------------------------------------------------------------------

SIX_AND_TWO = (*(f"AK.A{n}" for n in range(1, 7)), "EK.E1", "EK.E2")


@pytest.mark.parametrize(
    ("name", "shown"), [("krc4-rsi3", 101.0), ("krc5-rsi5", 101.0), ("krc2-rsi2", 101.0 * 180 / math.pi)]
)
def test_external_axes_are_received_in_mm_and_sent_in_the_unit_of_the_profile(name, shown):
    rig = ControllerRig(name, arm=on_a_gantry(), received=SIX_AND_TWO, sent=("DEF_EIPos", "DEF_ESPos"))
    rig.silent()
    for number in range(1, 41):
        rig.answer(external=(0.025 * number, -0.0125 * number))
    rig.answer(external=(1.0, -0.5), cycles=1000)
    assert rig.setpoint[6:] == [101.0, 29.5]
    assert values_of(rig.telegram, "EIPos") == pytest.approx([shown, 29.5, 0, 0, 0, 0], abs=1e-3)
    assert values_of(rig.telegram, "ESPos")[0] == pytest.approx(shown * 100 / 101, abs=1e-3)


def test_correcting_missing_external_axes_fails_with_axiscorrext():
    for name in ("krc4-rsi3", "krc5-rsi5"):
        with pytest.raises(
            KrcError, match=f"EK.E1, EK.E2, but the robot has no such .* AXISCORREXT fails on {name}"
        ):
            ControllerRig(name, received=SIX_AND_TWO)
    rig = ControllerRig("krc2-rsi2", received=SIX_AND_TWO)
    rig.answer(external=(1.0, 2.0), cycles=3)
    assert rig.state == "running"


def test_currents_and_function_generators_are_sent_on_request():
    rig = ControllerRig(sent=("DEF_MACur", "DEF_MECur", "DEF_Tech.C1"))
    rig.answer((0.001, 0, 0, 0, 0, 0), cycles=2)
    assert values_of(rig.telegram, "MACur")[0] != 0.0
    assert values_of(rig.telegram, "MECur") == [0.0] * 6
    assert len(values_of(rig.telegram, "Tech")) == 10


# --- pendant -----------------------------------------------------------------------------------------------


def test_an_estop_ends_the_run_and_the_next_one_starts_at_the_robots_position():
    rig = ControllerRig()
    rig.answer((0.1, 0, 0, 0, 0, 0), cycles=100)
    assert rig.operate("estop") is None
    assert rig.get(sen(ipoc_of(rig.telegram), (0.11, 0, 0, 0, 0, 0))) is None
    assert rig.state == "estopped"
    assert "possible: estop, reset, restart" in rig.operate("start")
    assert rig.operate("reset") is None
    assert rig.silent() is None
    assert rig.operate("start") is None
    rig.silent()
    programmed = values_of(rig.telegram, "ASPos")
    assert programmed == values_of(rig.telegram, "AIPos")
    assert programmed[0] == pytest.approx(0.1, abs=1e-4)
    rig.answer(cycles=50)
    assert values_of(rig.telegram, "AIPos")[0] == pytest.approx(programmed[0], abs=1e-5)
    assert (rig.state, rig.delay) == ("running", 0)


def test_a_paused_krc_is_silent_and_keeps_its_correction():
    rig = ControllerRig()
    rig.answer(STEP, cycles=5)
    before = int(ipoc_of(rig.telegram))
    rig.operate("pause")
    assert rig.silent(50) is None
    rig.operate("resume")
    rig.silent()
    assert rig.state == "waiting"
    assert int(ipoc_of(rig.telegram)) == before + 4 * 51
    assert (rig.setpoint[0], rig.delay) == (0.05, 0)
    rig.answer(STEP)
    assert rig.state == "running"


def test_counters_stand_still_in_a_pause():
    rig = ControllerRig("krc2-rsi2")
    rig.answer(cycles=5)
    before = int(ipoc_of(rig.telegram))
    rig.operate("pause")
    rig.silent(50)
    rig.operate("resume")
    rig.silent()
    assert int(ipoc_of(rig.telegram)) == before + 1


@pytest.mark.parametrize("name", PROFILE_NAMES)
def test_a_restart_in_motion_resets_everything_but_the_position(name):
    rig = ControllerRig(name)
    rig.silent(3)
    rig.answer(STEP, cycles=5)
    measured = rig.status["measured"]["A1"]
    old = ipoc_of(rig.telegram)
    rig.operate("restart")
    rig.get(sen(old, STEP))
    assert (rig.state, rig.delay, rig.status["rejected"]) == ("waiting", 0, {})
    assert ipoc_of(rig.telegram) != old
    assert (len(rig.telegram) < 100) is rig.profile.short_first
    assert rig.status["programmed"]["A1"] == pytest.approx(measured)
    rig.answer()
    assert rig.state == "running"


def test_jogging_is_possible_only_while_no_program_runs():
    rig = ControllerRig()
    rig.answer()
    assert "no jogging while running" in rig.controller.jog("A1", 5.0)
    rig.operate("pause")
    assert "there is no axis 'E1'" in rig.controller.jog("E1", 5.0)
    assert rig.controller.jog("A2", 5.0) is None
    rig.operate("resume")
    rig.silent()
    assert values_of(rig.telegram, "AIPos")[1] == pytest.approx(-85.0, abs=1e-5)
    assert values_of(rig.telegram, "ASPos")[1] == -90.0


def test_the_ipoc_can_jump():
    rig = ControllerRig()
    rig.controller.jump_ipoc(7)
    rig.answer()
    assert ipoc_of(rig.telegram) == "7"
    rig.answer()
    assert (ipoc_of(rig.telegram), rig.delay) == ("11", 0)


def test_controllers_with_equal_seeds_behave_equally():
    one, other = ControllerRig(ipoc=None), ControllerRig(ipoc=None)
    assert [one.answer(STEP) for _ in range(20)] == [other.answer(STEP) for _ in range(20)]
