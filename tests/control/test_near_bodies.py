"""Near bodies: effect of joints on a distance, approach of another robot, limits of a stop's end."""

import numpy as np
import pytest

from armgate.control.follower import Follower, Situation
from armgate.control.near_bodies import RESERVE, NearPair, approach, limits_near_bodies, opening
from armgate.control.repulsion import Obstacles

NONE = Obstacles()


def pair_at(model, q, body, beyond, room=0.0):
    """Return a point of the other body, beyond a point of a body in the body's own frame, m."""
    R, t = model.body_placements(q)
    point = t[body] + R[body] @ np.array([0.05, 0.0, 0.02])
    return NearPair(np.array([point, point + beyond]), model.bodies[body].joint, room)


def test_opening_is_the_slope_of_the_distance(fr, q):
    body = 4
    pair = pair_at(fr.model, q, body, np.array([0.1, -0.2, 0.05]))
    R, t = fr.model.body_placements(q)
    local = R[body].T @ (pair.points[0] - t[body])

    def place(at):
        R, t = fr.model.body_placements(at)
        return t[body] + R[body] @ local

    rate, lever = opening(fr.model, q, pair)
    h = 1e-6
    for j, e in enumerate(np.eye(6)):
        ways = place(q + h * e) - place(q - h * e)
        ends = [np.linalg.norm(place(q + s * h * e) - pair.points[1]) for s in (1.0, -1.0)]
        assert rate[j] == pytest.approx((ends[0] - ends[1]) / (2 * h), abs=1e-6)
        assert lever[j] == pytest.approx(np.linalg.norm(ways) / (2 * h), abs=1e-6)


def test_approach_is_the_distance_covered_during_a_stop(cell):
    gantry = cell.robot("GR")
    q, body = np.array(gantry.start), len(gantry.model.bodies) - 1
    end = q - 0.04 * np.eye(len(q))[0]
    point = gantry.model.body_placements(q)[1][body]
    ways = [
        approach(gantry.model, body, q, end, point, point + to)
        for to in ([-1.0, 0, 0], [1.0, 0, 0], [-1.0, 1.0, 0])
    ]
    assert ways == pytest.approx([0.04, 0.0, 0.04 / np.sqrt(2.0)])


def test_a_turning_stop_counts_too(fr):
    q, end, body = np.array(fr.start), np.array(fr.start), 4
    end[0] += 0.05
    point = fr.model.body_placements(q)[1][body]
    moved = fr.model.body_placements(end)[1][body]
    to = point + (moved - point) / np.linalg.norm(moved - point)
    assert approach(fr.model, body, q, end, point, to) == pytest.approx(np.linalg.norm(moved - point))


def test_far_away_nothing_is_limited(fr):
    far = pair_at(fr.model, fr.start, 4, np.array([0.0, 1.0, 0.0]), room=0.5)
    for pairs in ((), (far,)):
        lower, upper = limits_near_bodies(fr.model, fr.start, fr.start, fr.start, pairs)
        assert (lower < fr.start - 0.1).all()
        assert (upper > fr.start + 0.1).all()


def test_without_room_joints_may_only_increase_the_distance(fr):
    q = np.array(fr.start)
    pair = pair_at(fr.model, q, 4, np.array([0.0, 0.2, 0.0]))
    rate, lever = opening(fr.model, q, pair)
    assert rate[0] > 0.5 * lever[0] > 0.1  # A1 leads away in the positive direction
    end = q + 0.01
    lower, upper = limits_near_bodies(fr.model, q, q, end, (pair,))
    assert (lower[0], upper[0]) == (q[0], np.inf)
    # A2 moves the body at a right angle to the distance, so it may move to the end of its current stop.
    assert (lower[1], upper[1]) == (q[1], end[1])
    assert np.isinf([lower[3:], upper[3:]]).all()  # the wrist does not move the forearm


def test_a_joint_that_does_not_change_the_distance_stays_within_its_stop(fr):
    """Check A1, which turns link 1 about its own axis."""
    q = np.array(fr.start)
    pair = pair_at(fr.model, q, 1, np.array([0.3, 0.0, 0.0]))
    lower, upper = limits_near_bodies(fr.model, q, q, q + 0.02, (pair,))
    assert (lower[0], upper[0]) == (q[0], q[0] + 0.02)


def test_room_is_shared(fr):
    q = np.array(fr.start)
    pair = pair_at(fr.model, q, 1, np.array([0.3, 0.0, 0.0]), room=RESERVE + 0.01)
    _, lever = opening(fr.model, q, pair)
    _, upper = limits_near_bodies(fr.model, q, q, q, (pair,))
    assert upper[0] - q[0] == pytest.approx(0.01 / lever[0])


def test_the_robots_own_stop_reduces_the_room(fr):
    q = np.array(fr.start)
    pair = pair_at(fr.model, q, 4, np.array([0.0, -0.2, 0.0]), room=RESERVE + 0.05)
    end = q + 0.05 * np.eye(6)[0]  # A1 moving towards it
    limits = [limits_near_bodies(fr.model, q, q, stop, (pair,))[1][0] - stop[0] for stop in (q, end)]
    rate, lever = opening(fr.model, q, pair)
    moving = (lever > 1e-3).sum()
    assert limits == pytest.approx(
        [0.05 / (moving * lever[0]), (0.05 + 0.05 * rate[0]) / (moving * lever[0])]
    )


def test_the_follower_ends_its_stops_within_the_limits(law, bounds, fr):
    """Check a target to which A1 would turn, and a body beside link 1: the other joints turn the view."""
    follower = Follower(law, bounds, period=0.012, ahead=0.024)
    setpoint, last = np.array(fr.start), np.zeros(6)
    angles = []
    for k in range(120):
        end = setpoint + bounds.stop(last) * last
        pair = pair_at(fr.model, setpoint, 1, np.array([0.3, 0.0, 0.0]))
        now = Situation(
            0.012 * k, setpoint, last, setpoint, np.array([1.9, 0.5, 1.0]), 0.012 * k, 1.0, NONE, end, (pair,)
        )
        step = follower.step(now)
        angles.append(step.angle)
        setpoint, last = setpoint + step.dq, step.dq
    assert abs(setpoint[0] - fr.start[0]) < 1e-9
    assert np.degrees(angles[-1]) < 0.05
    assert np.degrees(angles[0]) > 10.0
