"""State of one robot: rest, limits after a start outside, lag window."""

import math

import pytest

from armgate.events import Plan, PlanKey, Tick
from armgate.gate.occupancy import occupancy_to
from armgate.gate.robot import JOINT_SLACK, RobotState
from gate import scenes

NOT = (0.0, 0.0)


def cart(window=0.0, tolerance=0.0):
    """Return the state of a cart of two joints within ±2 m before its first tick."""
    return RobotState.of(scenes.crossing(window, tolerance).robots[0], 0)


def tick(state, setpoint, q=None, time=None):
    number = state.tick + 1
    q = setpoint if q is None else q
    state.take_tick(Tick("fast", number, 0.012 * number if time is None else time, q, setpoint, NOT), q)


@pytest.mark.parametrize(
    ("tolerance", "off", "rests"),
    [(0.0, 0.5e-6, True), (0.0, 1e-6, True), (0.0, 1.5e-6, False),
     (0.25, 0.25, True), (0.25, 0.25 + 0.9e-6, True), (0.25, 0.25 + 1.1e-6, False)],
)  # fmt: skip
def test_a_robot_rests_if_it_is_measured_within_the_tolerance_of_its_setpoint(tolerance, off, rests):
    state = cart(tolerance=tolerance)
    tick(state, NOT, (0.0, 0.5))
    assert not state.resting
    tick(state, NOT, (0.0, off))
    assert state.resting == rests


def test_a_robot_can_rest_off_its_setpoint():
    state = cart()
    for off, rests in ((0.5, False), (0.5, True), (0.4, False), (0.4 + 1e-6, True)):
        tick(state, NOT, (0.0, off))
        assert state.resting == rests


def test_a_robot_does_not_rest_at_the_tick_that_moves_its_setpoint():
    state = cart()
    tick(state, NOT)
    state.take_tick(Tick("fast", 1, 0.012, NOT, (1e-7, 0.0), (1e-7, 0.0)), NOT)
    assert not state.resting
    tick(state, (1e-7, 0.0))
    assert state.resting


@pytest.mark.parametrize(("since", "rests"), [(0.3, False), (0.499, False), (0.5, True), (0.6, True)])
def test_a_delayed_robot_rests_after_its_window_has_passed(since, rests):
    """Out and back: the robot is measured at its setpoint before it has gone out."""
    state = cart(window=0.5)
    tick(state, NOT, time=0.0)
    tick(state, (1.0, 0.0), NOT, time=0.9)
    for k in range(43):
        tick(state, NOT, time=1.0 + since * k / 42)
    assert state.resting == rests


def test_a_robot_rests_at_its_first_tick_at_its_setpoint():
    for window in (0.0, 0.5):
        state = cart(window)
        tick(state, (0.5, 0.0))
        assert state.resting


def test_a_robot_does_not_rest_with_a_pending_plan():
    """The link may accept the plan at any time; after a reset it would play a plan unknown to the gate."""
    state = cart()
    tick(state, NOT)
    assert state.resting
    state.pending = Plan("fast", PlanKey("s", 0, 1, -1), 1, (NOT,))
    assert not state.resting


def test_a_robot_does_not_rest_before_all_joints_have_arrived():
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
def test_limits_are_widened_only_for_joints_that_start_outside(start, low, high):
    state = cart()
    tick(state, start)
    assert state.outside == (low, high)
    now, b = state.limits_now(), state.bounds
    assert now.lower == tuple(x - (o + JOINT_SLACK) if o else x for x, o in zip(b.lower, low, strict=True))
    assert now.upper == tuple(x + (o + JOINT_SLACK) if o else x for x, o in zip(b.upper, high, strict=True))
    assert (now.names, now.speed, now.accel, now.decel) == (b.names, b.speed, b.accel, b.decel)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_widened_limits_shrink_with_the_joint_and_never_grow_again(side):
    state = cart()
    for place, outside in ((2.5, 0.5), (2.25, 0.25), (2.375, 0.25), (2.0, 0.0), (2.125, 0.0)):
        tick(state, (0.0, side * place))
        assert state.outside[side > 0] == (0.0, outside)
        assert state.outside[side < 0] == NOT
    assert state.limits_now() == state.bounds


def test_a_robot_inside_has_the_configured_limits():
    state = cart()
    tick(state, (2.0, -2.0))
    assert state.limits_now() == state.bounds


def test_without_a_lag_window_a_setpoint_is_kept_from_a_rebase_to_the_next_tick():
    state = cart()
    for x in (0.0, 0.1, 0.2):
        tick(state, (x, 0.0))
        assert list(state.history) == []
        state.rebase((x + 0.05, 0.0))
        assert list(state.history) == [(math.inf, (x, 0.0))]
    assert occupancy_to(state, (0.25, 0.0), NOT).tube == NOT


def test_a_rebase_to_the_same_setpoint_leaves_nothing_to_reserve():
    state = cart(window=0.5)
    tick(state, NOT)
    state.rebase(NOT)
    assert (list(state.history), state.resets) == ([], 1)


@pytest.mark.parametrize("tolerance", [0.0, 0.01])
def test_a_joint_keeps_its_setpoint_unless_its_position_differs_by_more_than_the_tolerance(tolerance):
    state = cart(tolerance=tolerance)
    tick(state, (0.5, 0.25), (0.5 + 0.5 * tolerance, 0.5))
    assert state.setpoint_after_reset() == (0.5, 0.5)
    tick(state, (0.5, 0.25), (0.5 - tolerance, 0.25 + tolerance))
    assert state.setpoint_after_reset() == (0.5, 0.25)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(
    ("faulted", "setpoint", "q", "stands"),
    [
        (False, 1.5, 2.005, 2.0),  # the limit is 2.0, the tolerance 0.01
        (False, 1.5, 2.5, 2.0),
        (False, 2.25, 2.5, 2.25),  # already outside: not farther
        (False, 2.25, 2.125, 2.125),
        (True, 1.5, 2.005, 2.0),
        (True, 1.5, 2.5, 2.5),  # pushed there
        (True, 1.5, 1.75, 1.75),
    ],
)
def test_a_reset_moves_no_joint_out_of_its_limits(faulted, setpoint, q, stands, side):
    state = cart(tolerance=0.01)
    state.faulted = faulted
    tick(state, (0.0, side * setpoint), (0.0, side * q))
    assert state.setpoint_after_reset() == (0.0, side * stands)


def test_a_robot_that_faulted_is_reset_at_its_measured_position():
    state = cart()
    tick(state, (2.5, 0.0))
    tick(state, (2.25, 0.0))
    assert state.outside == (NOT, (0.25, 0.0))
    state.faulted, state.off_path = True, 0.5
    tick(state, (2.25, 0.0), (2.75, 0.0))
    state.rebase(state.setpoint_after_reset())
    assert (state.q, state.off_path, state.outside) == ((2.75, 0.0), 0.0, (NOT, (0.75, 0.0)))


def test_a_setpoint_counts_until_the_window_has_passed_since_it_was_replaced():
    """The edge is exact to the rounding of times. A clock may be faster than its configured period."""
    state = cart(window=0.012)
    tick(state, (1.0, 0.0))
    edge = 1.0 - 0.012 - 1e-9
    recent = [(0.999, (0.3, 0.0))]
    kept = [(edge, (0.2, 0.0)), (0.99, (0.25, 0.0))]
    state.history.extend([(math.nextafter(edge, 0.0), (0.1, 0.0)), *kept, *recent])
    tick(state, (1.5, 0.0), time=1.0)
    assert list(state.history) == [*kept, *recent, (1.0, (1.0, 0.0))]


@pytest.mark.parametrize(("window", "ticks"), [(0.001, 2), (0.012, 2), (0.015, 3), (0.024, 3), (0.025, 4)])
def test_a_setpoint_counts_for_the_ticks_of_the_window_and_one_more_with_any_time_stamps(window, ticks):
    state = cart(window=window)
    for k in range(8):
        tick(state, (0.1 * k, 0.0), time=10.0 * k)
    assert [q[0] for _, q in state.history] == pytest.approx([0.1 * k for k in range(7)][-ticks:])


def test_after_a_reset_a_delayed_robot_may_still_move_to_the_old_setpoint():
    state = cart(window=0.5)
    tick(state, NOT, time=0.0)
    tick(state, (1.0, 0.0), NOT, time=0.25)
    state.rebase(NOT)
    assert (state.setpoint, state.played, state.resets) == (NOT, -1, 1)
    assert (math.inf, (1.0, 0.0)) in state.history
    assert occupancy_to(state, NOT, NOT).nodes == ((1.0, 0.0), NOT)
    tick(state, NOT, time=0.5)
    assert (0.5, (1.0, 0.0)) in state.history  # for the window after the tick that reports the reset


@pytest.mark.parametrize("window", [0.0, 0.1])
def test_standstill_before_a_change_of_the_setpoint_does_not_count_as_rest(window):
    """The robot has not begun to move yet: it lags, or its delay has just passed."""
    state = cart(window, tolerance=1e-3)
    for k in range(200):
        tick(state, NOT, time=0.01 * k)
    assert state.resting
    for k, q in enumerate((0.0, 1e-3, 1.5e-3, 2e-3)):
        tick(state, (0.1, 0.0), (q, 0.0), time=2.0 + window + 0.01 * (k - (window > 0)))
        assert not state.resting


def test_a_setpoint_that_differs_by_rounding_from_the_gates_own_sum_has_not_changed():
    state = cart(window=0.5)
    tick(state, (0.1, 0.0), time=0.0)
    for k in range(1, 5):
        tick(state, (0.1 + 0.5e-9, 0.0), (0.3, 0.0), time=0.01 * k)
    assert state.changed == -math.inf
    assert state.setpoint == (0.1, 0.0)
    assert state.resting


def test_a_setpoint_that_changes_at_the_second_tick_has_changed():
    state = cart(window=0.5)
    tick(state, NOT, time=0.0)
    tick(state, (1.0, 0.0), NOT, time=0.9)
    assert state.changed == 0.9
    tick(state, (1.0, 0.0), NOT, time=1.0)
    assert not state.resting


@pytest.mark.parametrize(
    ("faulted", "lag_tube", "stands"), [(True, 0.0, 0.75), (False, 0.5, 0.75), (False, 0.0, 0.5)]
)
def test_the_setpoint_after_a_reset_is_the_measured_or_the_settled_position(faulted, lag_tube, stands):
    """The measured one after a fault, and if the axes lag differently; the settled one in all other cases."""
    cell = scenes.crossing()
    robot = (scenes.lagging(cell, 0.03, lag_tube) if lag_tube else cell).robots[0]
    state = RobotState.of(robot, 0)
    tick(state, NOT)
    state.faulted, state.q, state.measured = faulted, (0.5, 0.0), (0.75, 0.0)
    assert state.setpoint_after_reset() == (stands, 0.0)


def test_the_largest_increments_are_kept_only_for_axes_that_lag_differently():
    """At the first tick the increment is the distance from the measured position to the setpoint."""
    lag_tube = RobotState.of(scenes.lagging(scenes.crossing(), 0.03, 0.5).robots[0], 0)
    for state, counts in ((lag_tube, 1.0), (cart(), 0.0)):
        tick(state, (1.0, 1.0), (0.5, 0.75))
        assert state.largest.largest == (counts * 0.5, counts * 0.25)
        tick(state, (1.5, 0.5))
        tick(state, (1.625, 0.5))
        assert state.largest.largest == (counts * 0.5, counts * 0.5)


@pytest.mark.parametrize(("ticks", "rests"), [(1, False), (2, True)])
def test_a_robot_off_its_setpoint_rests_after_the_ticks_of_its_window_with_any_time_stamps(ticks, rests):
    """The robot stands elsewhere, with a lag window of two ticks, stamped eight periods apart."""
    state = cart(window=0.024)
    tick(state, NOT, time=0.0)
    for k in range(1, ticks + 2):
        tick(state, (0.1, 0.0), (0.5, 0.0), time=0.1 * k)
    assert state.resting == rests


def test_a_rebase_counts_as_an_increment_for_axes_that_lag_differently():
    state = RobotState.of(scenes.lagging(scenes.crossing(), 0.03, 0.5).robots[0], 0)
    tick(state, NOT)
    state.rebase((0.5, 0.25))
    assert state.largest.largest == (0.5, 0.25)


@pytest.mark.parametrize("wrong", [1e9, -1e9])
def test_a_wrong_time_stamp_neither_ends_the_lag_window_at_once_nor_keeps_it_forever(wrong):
    """The lag window is 24 ms, the period 12 ms; the setpoint changes at the tick with the wrong stamp."""
    state = cart(window=0.024)
    tick(state, NOT)
    assert state.resting
    tick(state, (0.1, 0.0), time=wrong)
    rests = []
    for _ in range(4):
        tick(state, (0.1, 0.0))
        rests.append(state.resting)
    assert rests == ([False, False, True, True] if wrong > 0 else [False, True, True, True])
