"""Tests of the virtual clock and the wall clock: instants of mixed periods, drift, and missed ticks."""

import asyncio
import itertools
import os
import threading
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from armgate.emulator import Lateness, VirtualClock, WallClock
from armgate.emulator.timer import Timer


def test_instants_of_mixed_periods_coincide_exactly():
    clock = VirtualClock([0.012, 0.004, 0.02])
    instants = [clock.advance() for _ in range(18)]
    assert instants[0].ns == 0
    assert instants[0].due == (0, 1, 2)
    at = {i.ns: i.due for i in instants}
    assert at[12_000_000] == (0, 1)
    assert at[20_000_000] == (1, 2)
    assert at[60_000_000] == (0, 1, 2)
    assert [i.number for i in instants] == list(range(18))


def test_instants_do_not_drift_in_a_long_run():
    clock = VirtualClock([0.012, 0.004])
    for _ in range(250_000):
        instant = clock.advance()
    assert instant.ns == 249_999 * 4_000_000
    assert clock.next_ns == 1_000_000_000_000
    assert clock.advance().due == (1,)


@given(st.lists(st.integers(1, 40), min_size=1, max_size=5))
def test_every_robot_ticks_once_a_period(milliseconds):
    clock = VirtualClock([m / 1000 for m in milliseconds])
    end = 200_000_000
    seen = {index: [] for index in range(len(milliseconds))}
    while clock.next_ns < end:
        instant = clock.advance()
        assert instant.due == tuple(sorted(instant.due))
        for index in instant.due:
            seen[index].append(instant.ns)
    for index, m in enumerate(milliseconds):
        assert seen[index] == list(range(0, end, m * 1_000_000))


@pytest.mark.parametrize("periods", [[], [0.0], [0.012, -1.0]])
def test_periods_that_are_not_positive_are_refused(periods):
    with pytest.raises(ValueError, match="periods"):
        VirtualClock(periods)


def test_lateness_counts_halves_and_overruns():
    lateness = Lateness()
    for late in (100, 501, 1000, 2500):
        lateness.note(late, 1000)
    assert (lateness.count, lateness.half, lateness.overruns) == (4, 3, 2)
    assert lateness.worst == pytest.approx(2500e-9)


async def ticks_of(clock_of, count):
    """Run a wall clock until ``count`` instants have passed."""
    instants, done = [], asyncio.Event()

    def tick(instant):
        instants.append(instant)
        if len(instants) == count:
            done.set()

    clock = clock_of(tick)
    clock.start()
    try:
        await asyncio.wait_for(done.wait(), 20)
    finally:
        clock.close()
    return instants, clock


async def test_the_wall_clock_has_the_instants_of_the_virtual_clock():
    instants, clock = await ticks_of(lambda tick: WallClock([0.004, 0.006], tick), 12)
    virtual = VirtualClock([0.004, 0.006])
    assert instants == [virtual.advance() for _ in instants]
    assert clock.time >= instants[-1].time
    assert clock.lateness.count == len(instants)


async def test_missed_ticks_follow_after_a_stall():
    """Let the clock jump by ten periods between two ticks: all ten follow, and count as overruns."""
    jump = 10_000_000
    stalled = itertools.chain([0, 0], itertools.repeat(jump))
    base = None

    def now():
        nonlocal base
        real = time.monotonic_ns()
        base = real if base is None else base
        return base + next(stalled)

    instants, clock = await ticks_of(lambda tick: WallClock([0.001], tick, now), 11)
    assert [i.number for i in instants] == list(range(len(instants)))
    assert clock.lateness.overruns >= 10
    assert clock.lateness.worst >= 0.010


async def test_sockets_are_served_between_delayed_ticks():
    """Run a clock that is always late: another callback still runs between any two ticks."""
    order = []

    def tick(instant):
        order.append("tick")
        asyncio.get_running_loop().call_soon(order.append, "other")

    done = asyncio.Event()
    clock = WallClock([1e-6], tick)
    clock.start()
    asyncio.get_running_loop().call_later(0.02, done.set)
    await asyncio.wait_for(done.wait(), 20)
    clock.close()
    assert all(pair != ("tick", "tick") for pair in itertools.pairwise(order))


async def test_a_closed_clock_does_not_tick_and_can_be_closed_again():
    instants, clock = await ticks_of(lambda tick: WallClock([1e-6], tick), 3)
    count = len(instants)
    for _ in range(10):  # far more than a microsecond has passed
        await asyncio.sleep(0)
    clock.close()
    assert len(instants) == count


def test_a_timer_expires_once():
    timer = Timer()
    try:
        assert not timer.expired()
        timer.arm(0)  # in the past
        os.set_blocking(timer.fileno(), True)
        waiting = threading.Thread(target=timer.expired)
        waiting.start()
        waiting.join(10)
        assert not waiting.is_alive()
        os.set_blocking(timer.fileno(), False)
        assert not timer.expired()
    finally:
        timer.close()


def test_a_timer_that_the_kernel_refuses_raises_the_reason():
    timer = Timer()
    timer.close()
    with pytest.raises(OSError, match="timerfd"):
        timer.arm(1)
