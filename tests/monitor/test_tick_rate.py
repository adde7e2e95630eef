"""Comparison of ticks with time: fast clocks are found; delays, losses, pauses and bursts raise no alarm."""

import random
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from armgate.daemon.recording.recorder import Recorder
from armgate.monitor.model import build
from armgate.monitor.monitor import Monitor
from armgate.monitor.offline import check_recording
from armgate.monitor.tick_rate import TickRate
from armgate.monitor.yaml_files import read_files
from monitor.watched import ARM, GANTRY, Watched, demo, saved

PERIODS = (0.004, 0.012, 0.05)


def found_at(rate: TickRate, ticks: Iterator[tuple[int, float]]) -> float | None:
    """Return the time at which the first tick is ahead of its time."""
    return next((time for tick, time in ticks if rate.check(tick, time) is not None), None)


# --- real clocks ----------------------------------------------------------------------------------


def late(
    delays: Iterator[float], period: float, ticks: int, drift: float = 0.0
) -> Iterator[tuple[int, float]]:
    """Yield ticks of a clock on time, each stamped after its delay, in increasing order."""
    stamp = 0.0
    for tick, delay in zip(range(ticks), delays, strict=False):
        stamp = max(tick * period * (1.0 - drift) + delay, stamp + 1e-5)
        yield tick, stamp


def jittered(seed: int) -> Iterator[float]:
    """Yield the delays of a busy machine: up to half a tick always, 0.1 s often."""
    chance = random.Random(seed)
    while True:
        yield chance.random() * 0.006 + (0.1 if chance.random() < 0.3 else 0.0)


def stalled(seed: int, length: float, period: float) -> Iterator[float]:
    """Yield the delays of a process that stalls repeatedly, and then processes the backlog."""
    chance = random.Random(seed)
    while True:
        yield from (0.001 for _ in range(chance.randrange(1, round(8.0 / period))))
        n = round(length / period)
        yield from (length - i * period for i in range(n))


@pytest.mark.parametrize("period", PERIODS)
@pytest.mark.parametrize("drift", [-3e-4, 0.0, 3e-4])
def test_jitter_and_the_drift_of_a_crystal_raise_no_alarm(period, drift):
    assert found_at(TickRate(period), late(jittered(1), period, 50_000, drift)) is None


@pytest.mark.parametrize("period", PERIODS)
@pytest.mark.parametrize("length", [0.3, 1.0, 2.0])
def test_bursts_after_a_stall_raise_no_alarm(period, length):
    for seed in range(5):
        assert found_at(TickRate(period), late(stalled(seed, length, period), period, 20_000)) is None


@pytest.mark.parametrize("period", PERIODS)
def test_lost_ticks_and_pauses_raise_no_alarm(period):
    """Each telegram is a tick: a lost telegram or a pause of the program delays all later ticks."""
    chance, time, ticks = random.Random(2), 0.0, []
    for tick in range(30_000):
        time += period * (1 + (chance.random() < 0.2)) + (30.0 if chance.random() < 1e-4 else 0.0)
        ticks.append((tick, time + chance.random() * 0.05))
    assert found_at(TickRate(period), iter(ticks)) is None


@pytest.mark.parametrize("period", PERIODS)
def test_states_that_are_missed_raise_no_alarm(period):
    chance = random.Random(3)
    ticks = ((tick, time) for tick, time in late(jittered(4), period, 50_000) if chance.random() < 0.1)
    assert found_at(TickRate(period), ticks) is None


# --- clocks that are too fast -----------------------------------------------------------------------------


def faster(period: float, factor: float, since: float, jitter: float = 0.0) -> Iterator[tuple[int, float]]:
    """Yield ticks of a clock that becomes faster."""
    chance, time = random.Random(5), 0.0
    for tick in range(100_000):
        time += period / (factor if time >= since else 1.0)
        yield tick, time + chance.random() * jitter


@pytest.mark.parametrize("period", PERIODS)
@pytest.mark.parametrize(("factor", "within"), [(3.0, 0.5), (2.0, 1.0), (1.5, 2.0), (1.1, 9.0)])
def test_a_clock_that_becomes_too_fast_is_found(period, factor, within):
    time = found_at(TickRate(period), faster(period, factor, 20.0, jitter=0.01))
    assert time is not None
    assert 20.0 < time < 20.0 + within * max(1.0, 64 * period)


@pytest.mark.parametrize("period", PERIODS)
def test_a_clock_that_is_twice_as_fast_from_the_beginning_is_found(period):
    time = found_at(TickRate(period), faster(period, 2.0, 0.0, jitter=0.01))
    assert time is not None
    assert time < 2.0 * max(1.0, 64 * period)


def test_a_clock_that_becomes_too_fast_after_a_pause_is_found():
    """The delay of the pause does not count after 20 s."""
    ticks = ((tick, time + 60.0 * (tick > 500)) for tick, time in faster(0.012, 2.0, 30.0))
    time = found_at(TickRate(0.012), ticks)
    assert time is not None
    assert 90.0 < time < 91.0


def test_a_clock_that_stays_too_fast_is_found_again():
    pace, ticks = TickRate(0.012), faster(0.012, 2.0, 0.0)
    times = [found_at(pace, ticks) for _ in range(3)]
    assert None not in times
    assert times[2] < 7.0


# --- the states of a robot --------------------------------------------------------------------------------


def test_a_link_that_ticks_twice_as_fast_is_found_with_numbers(tmp_path):
    watched = Watched(demo(ARM, GANTRY), tmp_path)
    watched.beat = 0.006
    first = watched.rest(400)[0]
    assert (first.kind, first.robot) == ("pace", ARM)
    assert first.time < 2.0
    assert first.value > first.bound == pytest.approx(0.252)
    assert "ticks of 12 ms arrived in" in first.text
    assert "early by 0." in first.text


def test_a_link_that_ticks_twice_as_fast_is_found_in_a_recording(tmp_path):
    recorder = Recorder(tmp_path / "run", limit=1 << 30)
    watched = Watched(demo(ARM), tmp_path, recorder=recorder)
    watched.beat = 0.006
    watched.rest(350)
    recorder.close()
    _, summary = check_recording(tmp_path / "run", (), 1.0)
    assert {finding.kind for finding in summary.findings} == {"pace"}


@pytest.mark.parametrize("back", [0.0, 1e-3])
def test_a_time_that_does_not_increase_is_found(tmp_path, back):
    watched = Watched(demo(ARM), tmp_path)
    watched.rest(50)
    watched.falsify = lambda s: s.model_copy(update={"time": 49 * 0.012 - back})
    (found,) = watched.rest(1)
    assert (found.kind, found.tick) == ("form", 50)
    assert "previous tick, 0.588" in found.text


def test_ticks_of_a_link_that_is_not_ready_do_not_count(tmp_path):
    watched = Watched(demo(ARM), tmp_path)
    watched.beat = 0.006
    watched.falsify = lambda s: s.model_copy(update={"link": "lost"})
    assert watched.rest(400) == []


# --- lock-step --------------------------------------------------------------------------------------------


def exactly(folder: Path, period: str = "12 ms") -> Watched:
    """Return a monitor of a cell in lock-step."""
    tree = demo(ARM)
    tree["robots"][ARM]["period"] = period
    watched = Watched(tree, folder)
    watched.monitor = Monitor(build(read_files([saved(tree, folder / "true.yaml")])), lockstep=True)
    return watched


@pytest.mark.parametrize(("period", "ns"), [("12 ms", 12_000_000), ("12.3456789 ms", 12_345_679)])
def test_exact_times_in_lock_step_raise_no_alarm(tmp_path, period, ns):
    """Times are whole nanoseconds, even after a long time."""
    watched = exactly(tmp_path, period)
    for start in (0, 10**7):
        watched.falsify = lambda s, start=start: s.model_copy(
            update={"tick": start + s.tick, "time": (start + s.tick) * ns / 1e9}
        )
        assert watched.rest(30) == []


@pytest.mark.parametrize("wrong", [1e-6, -1e-6, 0.006, -0.006])
def test_a_tick_at_another_time_is_found_at_once_in_lock_step(tmp_path, wrong):
    watched = exactly(tmp_path)
    watched.rest(20)
    watched.falsify = lambda s: s.model_copy(update={"time": s.time + wrong})
    (found,) = watched.rest(1)
    assert (found.kind, found.tick) == ("pace", 20)
    assert "0.012000000 s are expected in lock-step" in found.text


def test_missed_states_have_the_time_of_their_ticks_in_lock_step(tmp_path):
    watched = exactly(tmp_path)
    watched.rest(3)
    (sample,) = (motion.last for motion in watched.monitor._motions)
    later = replace(sample, tick=sample.tick + 5, time=sample.time + 5 * 0.012)
    assert watched.monitor.check(later) == []
