"""Tests of the simulated network: disturbances, by seed."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from armgate.emulator.krc.process.network import Channel, Disturbance

MS = 1_000_000


def through(channel, count=1000, gap=4 * MS):
    """Send ``count`` numbers through the channel, one per ``gap``; return those received, in order."""
    out = []
    for number in range(count):
        channel.put(number, number * gap)
        out += [one for _, one in channel.get(number * gap)]
    return out + [one for _, one in channel.get(count * gap * 100)]


def test_a_network_without_disturbances_passes_all_datagrams_in_order():
    assert through(Channel("s", Disturbance())) == list(range(1000))


@given(seed=st.text(max_size=5), share=st.floats(0.1, 0.9))
def test_loss_drops_its_share_of_datagrams(seed, share):
    channel = Channel(seed, Disturbance(loss=share))
    out = through(channel)
    assert out == sorted(set(out))
    assert channel.counts["lost"] == 1000 - len(out)
    assert len(out) / 1000 == pytest.approx(1 - share, abs=0.09)


def test_duplicates_come_twice():
    channel = Channel("s", Disturbance(duplicate=0.3))
    out = through(channel)
    assert sorted(set(out)) == list(range(1000))
    assert len(out) - 1000 == channel.counts["duplicated"] > 200


def test_reordering_swaps_neighbours():
    channel = Channel("s", Disturbance(reorder=0.2))
    out = through(channel)
    swapped = [n for n, m in itertools.pairwise(out) if m == n - 1]
    assert len(swapped) >= channel.counts["reordered"] - 1 > 100
    assert set(range(999)) <= set(out)
    assert all(abs(place - one) <= 1 for place, one in enumerate(out))


def test_delayed_datagrams_arrive_late_with_their_due_time():
    channel = Channel("s", Disturbance(delay=0.010, jitter=0.005))
    channel.put("x", 0)
    assert list(channel.get(10 * MS - 1)) == []
    assert 10 * MS <= channel.next_due <= 15 * MS
    ((due, one),) = channel.get(15 * MS)
    assert (due, one, channel.next_due) == (pytest.approx(12.5 * MS, abs=2.5 * MS), "x", None)


def test_equal_seeds_lose_the_same_datagrams_with_other_settings():
    some = through(Channel("7 to-pc", Disturbance(loss=0.2)))
    assert through(Channel("7 to-pc", Disturbance(loss=0.2))) == some
    assert (
        sorted(set(through(Channel("7 to-pc", Disturbance(loss=0.2, duplicate=0.5, jitter=0.003))))) == some
    )
    assert through(Channel("8 to-pc", Disturbance(loss=0.2))) != some


def test_drop_loses_a_number_and_an_unplugged_cable_loses_all():
    channel = Channel("s", Disturbance())
    channel.drop(2)
    channel.change(cut=True)
    channel.put(0, 0)
    channel.change(cut=False)
    for number in (1, 2, 3):
        channel.put(number, 0)
    assert [one for _, one in channel.get(0)] == [3]
    assert channel.counts["lost"] == 3


@pytest.mark.parametrize(
    "wrong", [{"loss": -0.1}, {"duplicate": 1.5}, {"reorder": float("nan")}, {"delay": 11.0}]
)
def test_disturbances_out_of_range_are_refused(wrong):
    with pytest.raises(ValueError, match=f"{next(iter(wrong))} .*; expected"):
        Channel("s", Disturbance()).change(**wrong)
