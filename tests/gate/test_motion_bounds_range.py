"""Range of positions for which motion bounds hold."""

import numpy as np
import pytest

from armgate.gate.clearance.motion_bounds_range import MotionBoundsRange
from armgate.gate.clearance.swept import Space
from armgate.gate.robot import JOINT_SLACK, RobotState
from armgate.gate.tracking_lag import hull_deviation_of
from gate import scenes

ROOM = 1e-3


def slide(start=0.2, tolerance=0.0):
    """Return a robot with a revolute joint (±3 rad), a slide behind it (0 to 0.8 m), and a wrist."""
    return scenes.lever(start, tolerance).robots[0]


def ends(own, j=1):
    return float(own.ends[0][j]), float(own.ends[1][j])


@pytest.mark.parametrize(
    ("kinds", "parents", "levers"),
    [
        (("prismatic",), (-1,), ()),
        (("revolute", "prismatic"), (-1, 0), (1,)),
        (("prismatic", "revolute"), (-1, 0), ()),
        (("revolute", "prismatic", "prismatic"), (-1, 0, 1), (1, 2)),
        (("prismatic", "prismatic", "revolute", "prismatic"), (-1, 0, 1, 2), (3,)),
        (("revolute", "prismatic", "revolute", "prismatic"), (-1, -1, 1, 2), (3,)),  # a tree
    ],
)
def test_only_slides_behind_a_revolute_joint_count(kinds, parents, levers):
    ball = (scenes.body("sphere", 0.05),)
    joints = [scenes.joint(p, kind, bodies=ball) for kind, p in zip(kinds, parents, strict=True)]
    robot = {"urdf": scenes.urdf(joints), "start": [0.0] * len(kinds)}
    around = {"far": {"shape": {"sphere": 0.1}, "xyz": [50, 0, 0]}}
    (robot,) = scenes.build({"A": robot}, surroundings=around).robots
    assert MotionBoundsRange.of(robot).levers == levers


@pytest.mark.parametrize(
    ("start", "tolerance", "low", "high"),
    [
        (0.2, 0.0, -ROOM, 0.8 + ROOM),
        (0.2, 0.01, -ROOM - 0.02, 0.8 + ROOM + 0.02),
        (1.5, 0.0, -ROOM, 1.5 + ROOM),
        (-0.5, 0.0, -0.5 - ROOM, 0.8 + ROOM),
    ],
)
def test_a_range_begins_as_the_limits_and_the_configured_start_plus_some_room(start, tolerance, low, high):
    assert ends(MotionBoundsRange.of(slide(start, tolerance))) == pytest.approx((low, high), abs=1e-12)


def test_axes_that_lag_differently_need_more_room():
    robot = scenes.lagging(scenes.lever(), 0.03, 0.5).robots[0]
    stray = max(hull_deviation_of(robot).of(tuple(map(float, robot.velocity * robot.period)))[0])
    assert stray > 1e-3
    more = 2.0 * robot.q_tolerance + stray
    assert ends(MotionBoundsRange.of(robot)) == pytest.approx((-ROOM - more, 0.8 + ROOM + more), abs=1e-12)


def at(x, other=0.0):
    return (other, x, other)


@pytest.mark.parametrize("x", [0.0, 0.4, 0.8, 0.8 + 0.4e-3, -0.4e-3])
def test_a_position_inside_changes_nothing(x):
    own = MotionBoundsRange.of(slide())
    assert own.fitted([at(x), at(0.3)], 0.5e-3) is own


@pytest.mark.parametrize("x", [-ROOM, 0.8 + ROOM])
def test_the_edge_is_inside(x):
    own = MotionBoundsRange.of(slide())
    assert own.fitted([at(x)], 0.0) is own


def test_every_lever_must_be_inside():
    ball = (scenes.body("sphere", 0.05),)
    kinds = ("revolute", "prismatic", "prismatic")
    joints = [scenes.joint(k - 1, kind, bodies=ball) for k, kind in enumerate(kinds)]
    robot = {"urdf": scenes.urdf(joints), "start": [0.0] * 3}
    around = {"far": {"shape": {"sphere": 0.1}, "xyz": [50, 0, 0]}}
    own = MotionBoundsRange.of(scenes.build({"A": robot}, surroundings=around).robots[0])
    for out in ((0.0, 3.0, 0.0), (0.0, 0.0, 3.0), (0.0, -3.0, 0.0), (0.0, 0.0, -3.0)):
        assert own.fitted([out], 0.0) is not own


def test_only_levers_count():
    own = MotionBoundsRange.of(slide())
    assert own.fitted([at(0.4, other=50.0)], 0.0) is own


@pytest.mark.parametrize(
    ("places", "room", "low", "high"),
    [
        ([1.0], 0.0, -ROOM, 1.1),
        ([0.2, 1.0, 0.3], 0.05, -ROOM, 1.15),
        ([-0.5, 0.4], 0.0, -0.6, 0.8 + ROOM),
        ([-0.5, 1.0], 0.25, -0.85, 1.35),
        ([0.8 + 0.6e-3], 0.5e-3, -ROOM, 0.8 + 1.1e-3 + 0.1),
    ],
)
def test_outside_the_range_is_widened_by_what_is_needed_plus_a_step(places, room, low, high):
    fitted = MotionBoundsRange.of(slide()).fitted([at(x) for x in places], room)
    assert ends(fitted) == pytest.approx((low, high), abs=1e-12)
    assert fitted.levers == (1,)


def test_a_wider_range_stays_while_it_is_needed_and_sufficient():
    own = MotionBoundsRange.of(slide())
    wide = own.fitted([at(1.0)], 0.0)
    assert wide.fitted([at(1.1)], 0.0) is wide
    assert wide.fitted([at(0.9)], 0.0) is wide
    assert ends(wide.fitted([at(1.1001)], 0.0)) == pytest.approx((-ROOM, 1.2001))
    back = wide.fitted([at(0.8)], 0.0)
    assert ends(back) == ends(own)
    assert back.fitted([at(0.7)], 0.0) is back


def test_motion_bounds_are_computed_anew_only_outside_the_range():
    space = Space(scenes.lever())
    motion, bend = space.motion[0], space.bend[0]
    assert not space.fit(0, [at(0.4)], 0.0)
    assert space.motion[0] is motion
    assert space.bend[0] is bend
    assert space.fit(0, [at(2.0)], 0.0)
    assert np.all(space.motion[0] >= motion)
    assert space.motion[0].max() > motion.max() + 1.0  # a longer lever
    assert not space.fit(0, [at(2.0)], 0.0)


# --- positions that a robot can have ----------------------------------------------------------------------


def test_reachable_points_are_measured_commanded_and_formerly_commanded_positions():
    state = RobotState.of(scenes.crossing(0.5, tolerance=0.25).robots[0], 0)
    state.measured, state.q, state.setpoint = (0.1, 0.0), (0.2, 0.0), (0.3, 0.0)
    state.history.append((1.0, (0.4, 0.0)))
    assert state.reachable_points == [(0.1, 0.0), (0.2, 0.0), (0.3, 0.0), (0.3, 0.0), (0.4, 0.0)]
    assert state.reachable_margin == 0.25 + JOINT_SLACK
    state.off_path = 0.5
    assert state.reachable_margin == 0.75 + JOINT_SLACK


def test_the_reachable_margin_of_axes_that_lag_differently_covers_the_fastest_increment_or_a_larger_jump():
    cell = scenes.lagging(scenes.lever(), 0.03, 0.5)
    state = RobotState.of(cell.robots[0], 0)
    usual = state.robot.q_tolerance + JOINT_SLACK
    assert state.reachable_margin == usual + max(state.hull_deviation.of(state.bounds.speed)[0])
    state.largest.add((0.0, 0.5, 0.0))
    assert state.reachable_margin == usual + max(state.hull_deviation.of((0.0, 0.5, 0.0))[0])
