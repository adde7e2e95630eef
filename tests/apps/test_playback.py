"""The leader plays its path within its bounds, waits if the gate refuses increments, and ends at rest."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armgate.apps.lead.path import RecordedPath
from armgate.apps.lead.playback import SLOW, Playback
from armgate.apps.lead.shaping import Bounds

T = 0.012
BOUNDS = Bounds(np.array([1.0, 2.7]), np.array([4.0, 10.8]), np.array([4.0, np.inf]), T)


def path_of(q: np.ndarray, period: float = 0.05) -> RecordedPath:
    return RecordedPath(Path("x.csv"), "GR", ("X", "A1"), ("m", "rad"), period, q.copy(), 8)


def swing(seconds: float = 4.0) -> RecordedPath:
    t = np.linspace(0.0, 1.0, round(seconds / 0.05) + 1)
    s = (1 - np.cos(2 * np.pi * t)) / 2
    return path_of(np.stack([0.3 * s, -0.5 * s], axis=1))


class Robot:
    """Robot that plays the increments that ``gate`` admits, and records them."""

    def __init__(self, q: np.ndarray) -> None:
        self.setpoint, self.last, self.played = q.copy(), np.zeros_like(q), []

    def step(self, playback: Playback, gate=lambda dq, last: dq) -> None:
        dq = gate(playback.step(self.setpoint, self.last), self.last)
        self.setpoint, self.last = self.setpoint + dq, dq
        self.played.append(dq)

    def run(self, playback: Playback, most: int = 5000) -> int:
        for count in range(most):
            if playback.finished(self.setpoint, self.last):
                return count
            self.step(playback)
        raise AssertionError("never finished")


def within_bounds(played: list[np.ndarray]) -> None:
    u = np.array([np.zeros(2), *played])
    assert np.all(np.abs(u) <= BOUNDS.increment + 1e-12)
    assert np.all(np.abs(np.diff(u, axis=0)) <= BOUNDS.gain + 1e-12)


def test_playback_follows_the_path_closely_and_ends_at_rest() -> None:
    path, robot = swing(), Robot(np.zeros(2))
    playback = Playback(path, BOUNDS)
    while not playback.finished(robot.setpoint, robot.last):
        robot.step(playback)
        np.testing.assert_allclose(robot.setpoint, path.at(playback.time), atol=1e-4)
    np.testing.assert_allclose(robot.setpoint, path.at(path.duration), atol=1e-6)
    np.testing.assert_allclose(robot.last, 0.0, atol=1e-6)
    within_bounds(robot.played)
    assert playback.progress == 1.0
    assert len(robot.played) * T < path.duration + 1.0


def test_an_unobstructed_run_takes_the_duration_of_the_path() -> None:
    path = swing(6.0)
    ticks = Robot(np.zeros(2)).run(Playback(path, BOUNDS))
    assert path.duration <= ticks * T <= path.duration + 0.5


@given(st.floats(0.3, 3.9))
@settings(max_examples=25, deadline=None)
def test_a_shortened_run_rests_at_the_paths_position(seconds: float) -> None:
    path, robot = swing(), Robot(np.zeros(2))
    playback = Playback(path, BOUNDS, seconds)
    robot.run(playback)
    np.testing.assert_allclose(robot.setpoint, path.at(seconds), atol=1e-5)
    within_bounds(robot.played)
    assert playback.progress == 1.0


def test_the_robot_first_moves_to_the_start_slowly_and_straight() -> None:
    path, robot = swing(), Robot(np.array([-0.4, 0.3]))
    playback = Playback(path, BOUNDS)
    places = [robot.setpoint]
    while playback.approaching:
        robot.step(playback)
        places.append(robot.setpoint)
        assert playback.progress == 0.0
    u = np.diff(places, axis=0)
    assert np.all(np.abs(u) <= SLOW * BOUNDS.increment + 1e-9)
    off_line = np.array(places) @ np.array([0.3, 0.4])  # direction to the start: (-0.4, 0.3)
    # Small deviations occur because the acceleration is limited joint by joint.
    np.testing.assert_allclose(off_line, 0.0, atol=2e-3)
    robot.run(playback)
    within_bounds(robot.played)


def test_the_path_waits_while_the_gate_refuses_and_then_continues() -> None:
    path, robot = swing(), Robot(np.zeros(2))
    playback = Playback(path, BOUNDS)
    for _ in range(120):
        robot.step(playback)
    for _ in range(300):
        robot.step(playback, lambda _dq, last: BOUNDS.braking(last))
    assert playback.waiting
    held = playback.time
    assert np.max(np.abs(robot.setpoint - path.at(held)) / BOUNDS.velocity) < 0.25
    robot.run(playback)
    assert playback.progress == 1.0
    within_bounds(robot.played)
    np.testing.assert_allclose(robot.setpoint, path.at(path.duration), atol=1e-6)


@pytest.mark.slow
@settings(deadline=None, max_examples=25)
@given(st.tuples(st.floats(-2, 2), st.floats(-2, 2)), st.floats(0.2, 1.0))
def test_an_approach_arrives_without_overshoot(distance: tuple[float, float], share: float) -> None:
    left, last = np.array(distance), np.zeros(2)
    sign = np.sign(left)
    for _ in range(3000):
        last = BOUNDS.limit(BOUNDS.approach(left, share), last)
        left = left - last
        assert np.all(left * sign >= -1e-9)
    np.testing.assert_allclose(left, 0.0, atol=1e-6)


@settings(deadline=None, max_examples=25)
@given(st.tuples(st.floats(-1, 1), st.floats(-1, 1)))
def test_braking_is_straight_and_ends_at_rest(share: tuple[float, float]) -> None:
    last = np.array(share) * BOUNDS.increment
    direction = last.copy()
    for _ in range(200):
        now = BOUNDS.braking(last)
        assert np.all(np.abs(now - last) <= BOUNDS.gain + 1e-15)
        assert abs(now[0] * direction[1] - now[1] * direction[0]) < 1e-15
        last = now
    np.testing.assert_array_equal(last, 0.0)


def test_a_duration_beyond_the_path_is_clipped() -> None:
    assert Playback(swing(), BOUNDS, 100.0).end == pytest.approx(4.0)
