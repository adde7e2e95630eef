"""Tests of the console of a virtual KRC: commands on stdin and their answers."""

import json

import pytest

from armgate.emulator.krc.process.console import Console
from armgate.emulator.krc.process.network import Channel, Disturbance
from support.krcs import ControllerRig, ipoc_of


class Runner:
    """Substitute for the real-time runner."""

    port, slips, unsent = 4711, 0, 0

    def reopen(self):
        self.port += 1


class Bench:
    def __init__(self, **how):
        self.rig = ControllerRig(**how)
        self.channels = {name: Channel(name, Disturbance()) for name in ("to-pc", "to-krc")}
        self.console = Console(self.rig.controller, self.channels, Runner())

    def __call__(self, line):
        return json.loads(self.console.answer(line))


def test_status_has_state_positions_network_and_runner():
    bench = Bench()
    bench.rig.answer((0.05, 0, 0, 0, 0, 0), cycles=3)
    status = bench("status")
    assert (status["ok"], status["state"], status["delay"], status["ipoc"]) == (True, "running", 0, 112)
    assert (status["setpoint"]["A1"], status["programmed"]["A1"]) == (0.05, 0.0)
    assert status["network"]["to-krc"] == {"passed": 0, "lost": 0, "duplicated": 0, "reordered": 0}
    assert (status["port"], status["slips"], status["unsent"]) == (4711, 0, 0)


def test_pendant_events_change_the_state_and_each_run_has_a_new_port():
    bench = Bench(start=False)
    assert [bench(word)["state"] for word in ("start", "pause", "resume", "stop")] == [
        "waiting", "paused", "waiting", "stopped"
    ]  # fmt: skip
    assert bench("estop")["state"] == "estopped"
    assert bench("start") == {
        "ok": False, "error": "start has no effect while estopped; possible: estop, reset, restart"
    }  # fmt: skip
    assert bench("reset")["port"] == 4712
    assert bench("restart")["port"] == 4713


def test_jog_moves_an_axis_and_ipoc_sets_the_next_number():
    bench = Bench(start=False)
    assert bench("jog A3 -2.5")["measured"]["A3"] == 87.5
    assert bench("ipoc 42")["ok"]
    bench("start")
    assert ipoc_of(bench.rig.silent()) == "42"
    assert "no jogging while waiting" in bench("jog A1 1")["error"]


def test_disturbances_are_set_for_one_direction_or_both():
    bench = Bench()
    for line in ("loss 0.25", "delay 3 to-pc", "jitter 1 to-krc", "duplicate 1 to-pc", "reorder 0.5 to-krc"):
        assert bench(line)["ok"], line
    to_pc, to_krc = (channel.disturbance for channel in bench.channels.values())
    assert to_pc == Disturbance(loss=0.25, delay=0.003, duplicate=1.0)
    assert to_krc == Disturbance(loss=0.25, jitter=0.001, reorder=0.5)


def test_cable_out_loses_all_and_drop_loses_a_number_of_datagrams():
    bench = Bench()
    assert bench("cable out to-pc")["ok"]
    assert [channel.disturbance.cut for channel in bench.channels.values()] == [True, False]
    assert bench("cable out")["ok"]
    assert bench("cable in to-pc")["ok"]
    assert [channel.disturbance.cut for channel in bench.channels.values()] == [False, True]
    bench("drop 2 to-pc")
    for number in range(3):
        bench.channels["to-pc"].put(b"%d" % number, 0)
    assert [data for _, data in bench.channels["to-pc"].get(0)] == [b"2"]


@pytest.mark.parametrize(
    ("line", "text"),
    [
        ("", "there is no command ''; expected one of start, stop"),
        ("fly", "no command 'fly'"),
        ("answered", "no command 'answered'"),
        ("timeout", "no command 'timeout'"),
        ("estop now", "expected: estop"),
        ("status 1", "expected: status"),
        ("jog A1", "expected: jog AXIS BY"),
        ("jog A1 nan", "'nan'; expected a number"),
        ("jog A9 1", "no jogging while waiting"),
        ("ipoc -1", "'-1'; expected a whole number"),
        ("ipoc", "expected: ipoc N"),
        ("drop x", "'x'; expected a whole number"),
        ("drop 1 both", "expected: drop N [to-pc|to-krc]"),
        ("loss 1.5", "'1.5'; expected a number from 0 to 1"),
        ("delay 10001", "expected a number from 0 to 10000"),
        ("delay", "expected: delay VALUE [to-pc|to-krc]"),
        ("cable off", "cable 'off'; expected out or in"),
        ("\x00" * 5000, "there is no command"),
    ],
)
def test_an_invalid_command_is_answered_with_the_expected_form(line, text):
    answer = Bench()(line)
    assert answer["ok"] is False
    assert text in answer["error"]
    assert len(answer["error"]) < 400
