"""One robot, to the letter: its rest, its limits where it starts outside, its lag window."""

import math

import pytest

from armgate.cell.events import Plan, PlanKey, Tick
from armgate.integrity.robot import JOINT_SLACK, robot_state
from integrity import scenes

NOT = (0.0, 0.0)


def cart(window=0.0, tolerance=0.0):
    """A cart of two joints within ±2 m, its clock silent yet."""
    return robot_state(scenes.crossing(window, tolerance).robots[0], 0)


def tick(state, setpoint, q=None, time=None):
    number = state.tick + 1
    q = setpoint if q is None else q
    state.take_tick(Tick("fast", number, 0.012 * number if time is None else time, q, setpoint, NOT), q)


def test_how_far_it_moved_is_told_by_its_worst_joint_from_the_second_tick_on():
    state = cart()
    tick(state, (0.5, 0.0))
    assert state.moved == 0.0
    tick(state, (0.75, 0.125))
    assert state.moved == 0.25
    tick(state, (0.75, -0.375))
    assert state.moved == 0.5


@pytest.mark.parametrize(
    ("tolerance", "moved", "rests"),
    [(0.0, 0.5e-6, True), (0.0, 1e-6, True), (0.0, 1.5e-6, False),
     (0.25, 0.25, True), (0.25, 0.26, False), (0.25, 1e-7, True)],
)  # fmt: skip
def test_it_rests_if_it_moves_no_more_than_its_measurement_may_err(tolerance, moved, rests):
    state = cart(tolerance=tolerance)
    tick(state, NOT)
    tick(state, NOT, (0.0, moved))
    assert state.resting == rests


def test_it_does_not_rest_while_any_joint_has_way_left():
    state = cart()
    tick(state, NOT)
    state.held = Plan("fast", PlanKey("s", 0, 1, -1), 1, (NOT, (0.0, 1e-3)))
    assert not state.resting
    state.played = 1
    assert state.resting


@pytest.mark.parametrize(
    ("start", "low", "high"),
    [
        ((-2.5, 0.0), (0.5, 0.0), NOT),
        ((0.0, 2.25), NOT, (0.0, 0.25)),
        ((2.5, -2.25), (0.0, 0.25), (0.5, 0.0)),
    ],
)
def test_limits_are_widened_where_it_starts_outside_and_nowhere_else(start, low, high):
    state = cart()
    tick(state, start)
    assert state.outside == (low, high)
    now, b = state.limits_now(), state.bounds
    assert now.lower == tuple(x - (o + JOINT_SLACK) if o else x for x, o in zip(b.lower, low, strict=True))
    assert now.upper == tuple(x + (o + JOINT_SLACK) if o else x for x, o in zip(b.upper, high, strict=True))
    assert (now.names, now.speed, now.accel, now.decel) == (b.names, b.speed, b.accel, b.decel)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_limits_come_in_with_it_and_never_go_out_again(side):
    state = cart()
    for place, outside in ((2.5, 0.5), (2.25, 0.25), (2.375, 0.25), (2.0, 0.0), (2.125, 0.0)):
        tick(state, (0.0, side * place))
        assert state.outside[side > 0] == (0.0, outside)
        assert state.outside[side < 0] == NOT
    assert state.limits_now() == state.bounds


def test_who_is_inside_has_the_limits_of_the_configuration():
    state = cart()
    tick(state, (2.0, -2.0))
    assert state.limits_now() == state.bounds


def test_without_a_lag_window_no_setpoint_is_kept():
    state = cart()
    for x in (0.0, 0.1, 0.2):
        tick(state, (x, 0.0))
        state.rebase()
        assert list(state.history) == []
    assert state.occupancy_to((0.2, 0.0), NOT).tube == NOT


def test_a_setpoint_counts_until_the_window_has_passed_since_it_was_left():
    """To the rounding of times, and no longer."""
    state = cart(window=0.5)
    tick(state, (1.0, 0.0))
    edge = 1.0 - 0.5 - 1e-9
    kept = [(edge, (0.2, 0.0)), (0.5, (0.3, 0.0))]
    state.history.extend([(math.nextafter(edge, 0.0), (0.1, 0.0)), *kept])
    tick(state, (1.5, 0.0), time=1.0)
    assert list(state.history) == [*kept, (1.0, (1.0, 0.0))]


def test_after_a_reset_a_delayed_robot_may_still_be_on_its_way_to_the_old_setpoint():
    state = cart(window=0.5)
    tick(state, NOT, time=0.0)
    tick(state, (1.0, 0.0), NOT, time=0.25)
    state.rebase()
    assert (state.setpoint, state.played, state.resets) == (NOT, -1, 1)
    assert (math.inf, (1.0, 0.0)) in state.history
    assert state.occupancy_to(NOT, NOT).tube[0] == 1.0
    tick(state, NOT, time=0.5)
    assert (0.5, (1.0, 0.0)) in state.history  # as long as the window from the tick that heard of it
