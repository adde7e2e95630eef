"""Largest motion of a KRC's robot in any combination of mode, HOLDON, ASPos, AXISCORR and the cell's mode.

The probe of the link moves each axis by at most `ProbeSize.farthest` before any other motion. The bounds
below are that distance, or the motion that a controller has commanded.
"""

import math
import re
from dataclasses import replace
from itertools import product

import pytest

from armgate.emulator.krc.context import Limits, Mode
from armgate.links.rsi.probe import Probe, digits_of, probe_size
from support.krcs import krc_file
from support.rsi import SEND, SIX, WIDE, Rig
from support.rsi_ends import SLOW, at_rest, nothing_moves

NARROW = Limits(0.5)
"""AXISCORR, deg: wider than the probe, narrower than the motion that is commanded afterwards."""
MODES = ("absolute", "relative")


class Travel:
    """Largest distance of each axis from its start, over cycles of a rig."""

    def __init__(self, rig):
        self.rig, self.start = rig, rig.krc_setpoint
        self.far = [0.0] * len(self.start)

    def cycles(self, count, until=lambda: False, **how):
        for _ in range(count):
            self.rig.cycle(**how)
            self.update()
            if until():
                return

    def update(self):
        rows = zip(self.far, self.rig.krc_setpoint, self.start, strict=True)
        self.far = [max(far, abs(now - start)) for far, now, start in rows]

    def within(self, bounds):
        return all(far <= bound + 1e-7 for far, bound in zip(self.far, bounds, strict=True))


def rig_of(folder, *, cell, krc, hold=1, aspos="stands", limits=WIDE, **how):
    peer = krc_file(SEND, SIX, hold=hold)
    return Rig(
        folder, mode=cell, krc_mode=krc, peer_file=peer, aspos=aspos, limits=limits, monitor=WIDE, **how
    )  # fmt: skip


@pytest.mark.daily(1)
@pytest.mark.parametrize(
    ("cell", "krc", "hold", "aspos", "limits"),
    [
        pytest.param(*case, id="-".join((*case[:2], f"holdon{case[2]}", case[3], width)))
        for case, width in (
            ((cell, krc, hold, aspos, limits), width)
            for cell, krc, hold, aspos in product(MODES, MODES, (0, 1), ("stands", "moves"))
            for width, limits in (("narrow", NARROW), ("wide", WIDE))
        )
    ],
)
def test_no_combination_moves_an_axis_farther_than_documented(tmp_path, cell, krc, hold, aspos, limits):
    rig = rig_of(tmp_path, cell=cell, krc=krc, hold=hold, aspos=aspos, limits=limits)
    rig.operate("start")
    farthest, travel = probe_size(rig.setup).farthest, Travel(rig)
    travel.cycles(600, lambda: rig.state in ("ready", "faulted"))
    assert travel.within(farthest)
    assert not any(any(tick.increment) for tick in rig.ticks)  # no plan was played
    if cell != krc:
        refused(rig, travel, farthest, krc)
        return
    assert rig.state == "ready", rig.changes
    rig.take_lease()
    for _ in range(60):
        rig.command(*SLOW)
        travel.cycles(1)
    travel.cycles(400)
    if limits is WIDE:
        assert rig.quiet
        assert travel.far[0] > math.radians(2.0)
        return
    # AXISCORR limits silently: the robot stops at the limit, and is held.
    assert rig.state == "faulted"
    assert travel.within([math.radians(0.5)] * 6)
    stands = rig.krc_setpoint
    rig.cycles(50)
    assert rig.krc_setpoint == stands


def refused(rig, travel, farthest, krc):
    """Check that the link has named the mode, and that the robot stays at its start, also after a reset."""
    assert rig.state == "faulted"
    assert f"RSI_ON(#{krc.upper()})" in rig.changes[-1].reason
    travel.cycles(50)
    assert rig.reset()
    travel.cycles(300)
    assert (rig.state, rig.krc_state) == ("faulted", "running")
    rig.take_lease()
    nothing_moves(rig)
    travel.cycles(100, to_krc=False)  # with either HOLDON
    assert travel.within(farthest)
    assert rig.krc_setpoint == pytest.approx(travel.start, abs=1e-7)


def farther(shape, lost):
    """Return the bounds of a probe in which this number of successive datagrams is lost."""
    return [far + lost * amplitude for far, amplitude in zip(shape.farthest, shape.amplitude, strict=True)]


@pytest.mark.daily(2)
@pytest.mark.parametrize(("cell", "krc"), list(product(MODES, MODES)))
@pytest.mark.parametrize("hold", [0, 1])
@pytest.mark.parametrize("lost", ["to_krc", "to_pc"])
@pytest.mark.parametrize("at", [4, 10])
def test_a_datagram_lost_in_the_probe_adds_at_most_one_amplitude(tmp_path, cell, krc, hold, lost, at):
    rig = rig_of(tmp_path, cell=cell, krc=krc, hold=hold)
    rig.operate("start")
    shape, travel = probe_size(rig.setup), Travel(rig)
    travel.cycles(100, lambda: rig.krc_setpoint != travel.start)
    travel.cycles(at)
    travel.cycles(1, **{lost: False})
    travel.cycles(600, lambda: rig.state in ("ready", "faulted"))
    assert rig.state == ("ready" if cell == krc and hold != (cell == "relative") else rig.state)
    assert (rig.state == "ready") <= (cell == krc)
    assert travel.within(farther(shape, 1))
    travel.cycles(100)
    assert travel.within(farther(shape, 1))


@pytest.mark.daily(4)
@pytest.mark.parametrize(("cell", "krc"), list(product(MODES, MODES)))
@pytest.mark.parametrize("hold", [0, 1])
@pytest.mark.parametrize("count", [3, 15])
def test_replies_lost_at_the_peak_of_the_probe_add_one_amplitude_each(tmp_path, cell, krc, hold, count):
    rig = rig_of(tmp_path, cell=cell, krc=krc, hold=hold)
    rig.operate("start")
    shape, travel = probe_size(rig.setup), Travel(rig)
    travel.cycles(100, lambda: rig.krc_setpoint != travel.start)
    travel.cycles(shape.half // 2 - 1)
    travel.cycles(count, to_krc=False)
    travel.cycles(700, lambda: rig.state in ("ready", "faulted"))
    travel.cycles(100)
    assert travel.within(farther(shape, count))
    if krc == "relative" and hold == 1:
        assert travel.far[0] > count * shape.amplitude[0]
    if cell != krc:
        assert rig.state == "faulted"


@pytest.mark.parametrize("krc", MODES)
@pytest.mark.parametrize("cell", MODES)
def test_frozen_feedback_is_detected_and_the_robot_returns_to_its_start(tmp_path, cell, krc):
    rig = rig_of(tmp_path, cell=cell, krc=krc, hold=int(cell == "absolute"))
    rig.operate("start")
    rig.cycle()
    frozen = re.search(rb"<AIPos [^>]*/>", rig.telegram)[0]
    travel = Travel(rig)
    travel.cycles(300, edit=lambda data: re.sub(rb"<AIPos [^>]*/>", frozen, data))
    assert rig.state == "faulted"
    assert "A1 is not measured to follow" in rig.changes[-1].reason
    assert travel.within(probe_size(rig.setup).farthest)
    assert rig.krc_setpoint == pytest.approx(travel.start, abs=1e-7)


@pytest.mark.daily(3)
@pytest.mark.parametrize(("one", "other"), [("A1", "A2"), ("A4", "A5"), ("A1", "A6"), ("A3", "A4")])
@pytest.mark.parametrize("mode", MODES)
def test_axes_in_another_order_are_named(tmp_path, one, other, mode):
    """The KRC's signal flow swaps the corrections of two axes."""
    rig = rig_of(tmp_path, cell=mode, krc=mode, hold=int(mode == "absolute"))
    rig.operate("start")
    names = {one.encode(): other.encode(), other.encode(): one.encode()}
    travel = Travel(rig)
    for _ in range(600):
        rig.waiting = [
            replace(arrival, data=re.sub(rb"\b(A\d)(?==)", lambda m: names.get(m[1], m[1]), arrival.data))
            for arrival in rig.waiting
        ]
        travel.cycles(1)
        if rig.state in ("ready", "faulted"):
            break
    assert f"{one} is measured to move when {other} is corrected" in rig.changes[-1].reason
    assert travel.within([max(probe_size(rig.setup).farthest)] * 6)


@pytest.mark.daily(3)
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(("factor", "axis"), [(1.1, "A1"), (0.9, "A3"), (1.1, "E1"), (0.9, "E3")])
def test_a_scale_that_is_wrong_by_a_tenth_is_named_with_the_correct_one(tmp_path, mode, factor, axis):
    joint = {"E1": "X", "E3": "Z"}.get(axis, axis)
    own = f"{{{axis}: {{joint: {joint}, sent: {factor}}}}}"
    rig = Rig(tmp_path, gantry=True, mode=mode, axes=own)
    rig.operate("start")
    travel = Travel(rig)
    travel.cycles(600, lambda: rig.state in ("ready", "faulted"))
    reason = rig.changes[-1].reason
    found = re.search(
        rf"{axis} .* by ([\d.]+) of .*axes.{axis}.received ([\d.]+) .*or sent ([\d.]+) ", reason
    )
    assert found, reason
    assert [float(text) for text in found.groups()] == pytest.approx([factor, factor, 1.0], rel=0.03)
    assert travel.within([1.11 * far for far in probe_size(rig.setup).farthest])


@pytest.mark.parametrize("axis", ["A1", "A4", "E2"])
def test_an_axis_that_turns_the_other_way_is_named(tmp_path, axis):
    joint = {"E2": "Y"}.get(axis, axis)
    rig = Rig(tmp_path, gantry=True, axes=f"{{{axis}: {{joint: {joint}, sent: -1.0}}}}")
    rig.operate("start")
    rig.synchronise()
    assert f"{axis} is measured to move against its correction" in rig.changes[-1].reason


@pytest.mark.daily(2)
@pytest.mark.parametrize("profile", ["krc2-rsi2", "krc4-rsi3"])
@pytest.mark.parametrize("precision", [3, 4, 6])
@pytest.mark.parametrize("mode", MODES)
def test_a_correct_krc_passes_the_probe_in_every_resolution(tmp_path, profile, precision, mode):
    link = {"lag": "120 ms"} if profile == "krc2-rsi2" else {}
    rig = Rig(
        tmp_path, profile, mode=mode, precision=precision, cell_precision=precision,
        robot="    q_tolerance: 1.0e-5", **link,
    )  # fmt: skip
    rig.begin()
    rig.drive(40, *(0.2 * u for u in SLOW))
    at_rest(rig, 300)
    assert rig.quiet


def test_a_new_run_in_another_mode_is_proven_anew(tmp_path):
    rig = Rig(tmp_path).begin()
    rig.drive(40, *SLOW)
    at_rest(rig)
    rig.operate("stop")
    rig.krc._context = Rig(tmp_path, krc_mode="relative").krc._context
    rig.operate("start")
    begun = Travel(rig)
    begun.cycles(100)
    assert rig.state == "lost"
    assert rig.reset()
    begun.cycles(400)
    assert rig.state == "faulted"
    assert "RELATIVE" in rig.changes[-1].reason
    assert begun.within(probe_size(rig.setup).farthest)


@pytest.mark.daily(6)
@pytest.mark.parametrize("hold", [0, 1])
@pytest.mark.parametrize("share", [0.04, 0.1, 0.3, 1.0])
@pytest.mark.parametrize("before", [0, 40, 200])
def test_a_krc_that_begins_to_accumulate_corrections_is_stopped_by_zeros(tmp_path, hold, share, before):
    """Second line of defence: the mode changes during a run that has proven the other mode."""
    rig = rig_of(tmp_path, cell="absolute", krc="absolute", hold=hold).begin()
    dq = tuple(share * u for u in SLOW)
    rig.drive(before, *dq)
    at_rest(rig, 60)
    rig.krc._run.correction.mode = Mode.RELATIVE
    travel = Travel(rig)
    for _ in range(100):
        rig.command(*dq)
        travel.cycles(1)
    travel.cycles(200)
    assert travel.within([math.radians(2.5)] * 6)
    assert rig.stops
    if rig.krc_state == "faulted":  # a total this large exceeds the speed of a drive in one cycle
        return
    assert "moves on beyond its setpoints" in rig.changes[-1].reason
    stands = rig.krc_setpoint
    rig.cycles(50, to_krc=False)
    assert rig.krc_setpoint == stands


@pytest.mark.daily(2)
@pytest.mark.parametrize(("speed", "missed", "outwards"), [(5.0, 0, 1.0), (60.0, 0, -1.0), (20.0, 5, 1.0)])
@pytest.mark.parametrize("profile", ["krc2-rsi2", "krc4-rsi3"])
def test_an_absolute_krc_whose_robot_is_pushed_keeps_its_total(tmp_path, profile, speed, missed, outwards):
    """Zeros would command a step of the whole total, here 20°, although only a push moved the robot."""
    rig = Rig(tmp_path, profile, lag="120 ms" if profile == "krc2-rsi2" else "30 ms").begin()
    start = rig.krc_setpoint[0]
    rig.drive(round(0.7 / rig.period), *(outwards * 0.6 * rig.period if j == 0 else 0.0 for j in range(6)))
    at_rest(rig, round(1.0 / rig.period))
    held, total = rig.krc_setpoint, rig.replies[-1]
    assert outwards * (held[0] - start) > math.radians(20.0)
    pushed = 0.0

    def push(data):
        return re.sub(
            rb'(<AIPos A1=")([^"]*)', lambda m: m[1] + b"%.6f" % (float(m[2]) + outwards * pushed), data
        )

    for number in range(60):
        pushed = min(pushed + speed * rig.period, 2.0)
        rig.cycle(edit=push, to_pc=number % (missed + 1) == missed)
        assert re.findall(rb"<AK[^>]*>", rig.replies[-1]) == re.findall(rb"<AK[^>]*>", total)
    assert rig.krc_setpoint == held
    assert rig.stops


def test_a_run_that_is_proven_is_not_probed_again(tmp_path):
    rig = Rig(tmp_path).begin()
    rig.drive(40, *SLOW)
    rig.cycles(10, to_pc=False)
    rig.cycles(200)
    assert rig.state == "faulted"
    assert rig.reset()
    held = rig.krc_setpoint
    for _ in range(40):
        rig.cycle()
        assert rig.krc_setpoint == held
    assert rig.state == "ready"


def test_each_axis_has_a_distinct_code_of_digits():
    codes = {digits_of(number, 3) for number in range(-13, 14)}
    assert len(codes) == 27
    for code in codes:
        assert tuple(-digit for digit in code) in codes
    assert digits_of(5, 3) == (-1, -1, 1)


def test_the_probe_is_within_tolerance_speed_and_acceleration(tmp_path):
    for mode in MODES:
        rig = Rig(tmp_path, gantry=True, mode=mode)
        shape, setup = probe_size(rig.setup), rig.setup
        probe = Probe(setup)
        assert len({len(code) for code in probe.codes}) == 1
        for j in range(len(setup.axes)):
            assert shape.farthest[j] <= 0.5 * setup.tolerance[j] + 1e-12
            first = shape.amplitude[j] * math.sin(math.pi / shape.half)
            assert first <= 0.5 * setup.acceleration[j] * setup.period**2 + 1e-12
            assert shape.amplitude[j] <= 0.5 * setup.speed[j] * setup.period + 1e-12
