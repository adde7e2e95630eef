"""Ticks of the emulated link: the position is measured before the increment is played."""

import pytest

from armgate.emulator import EmulatedRobot
from armgate.events import Plan, PlanKey, Rebase, Tick
from armgate.links.emulated.link import EmulatedLink


def test_tick_zero_is_the_start_at_rest():
    link = EmulatedLink("A", "d1", (0.1, 0.2), 0.012, 0.03)
    assert link.robot == "A"
    expected = Tick("A", 0, 1.5, (0.1, 0.2), (0.1, 0.2), (0.0, 0.0))
    assert link.advance(1.5) == expected


def test_the_measured_position_follows_the_setpoint_with_one_tick_and_a_lag():
    link = EmulatedLink("A", "d1", (0.0,), 0.012, 0.03)
    link.advance(0.0)
    link.offer(Plan("A", PlanKey("d1", 0, 1, -1), 1, ((0.2,),)))
    ticks = [link.advance(0.012 * k) for k in range(1, 4)]
    reference = EmulatedRobot((0.0,), 0.012, 0.03)
    assert ticks[0].q == (0.0,)
    assert ticks[0].setpoint == (0.2,)
    assert ticks[1].q == reference.step((0.2,))
    assert ticks[2].q == reference.step((0.2,))
    assert [t.setpoint for t in ticks] == [(0.2,)] * 3


def test_after_a_rebase_the_robot_goes_to_the_new_setpoint_without_a_plan():
    link = EmulatedLink("A", "d1", (0.0,), 0.012, 0.03)
    link.advance(0.0)
    link.offer(Plan("A", PlanKey("d1", 0, 1, -1), 1, ((0.2,), (0.1,))))
    moved = link.advance(0.012)
    link.rebase(Rebase("A", moved.q, 1))
    tick = link.advance(0.024)
    assert tick.setpoint == moved.q
    assert tick.plan is None
    assert link.remaining == 0


def test_an_increment_of_another_length_raises_an_error():
    link = EmulatedLink("A", "d1", (0.0,), 0.012, 0.03)
    link.advance(0.0)
    link.offer(Plan("A", PlanKey("d1", 0, 1, -1), 1, ((0.2, 0.1),)))
    with pytest.raises(ValueError, match="zip"):
        link.advance(0.012)
