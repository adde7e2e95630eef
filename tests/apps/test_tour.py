"""The path of the demo matches its documentation."""

import numpy as np
import pytest

from armgate.apps.default_files import default_file
from armgate.apps.lead.path import RecordedPath, read_path
from armgate.cell.cell import Robot, build_cell
from armgate.cell.config import load_config

TICK = 0.012


@pytest.fixture(scope="module")
def tour() -> RecordedPath:
    return read_path(default_file("paths/inspection.csv"))


@pytest.fixture(scope="module")
def robot(tour: RecordedPath) -> Robot:
    return build_cell(load_config([default_file("demo.yaml")])).robot(tour.robot)


def tool(robot: Robot, tour: RecordedPath) -> np.ndarray:
    times = np.arange(0.0, tour.duration, TICK)
    return np.array([robot.model.frame(tour.at(t), robot.tool).t for t in times])


def test_the_tour_takes_about_a_minute_and_is_closed(tour: RecordedPath, robot: Robot) -> None:
    assert 50.0 < tour.duration < 60.0
    np.testing.assert_allclose(tour.at(0.0), robot.start, atol=1e-9)
    np.testing.assert_allclose(tour.at(tour.duration), robot.start, atol=1e-9)


def test_the_tool_stays_in_the_focus_box_and_uses_it(tour: RecordedPath, robot: Robot) -> None:
    away = tool(robot, tour) - [2.0, 0.0, 1.0]
    box = np.array([0.3, 0.7, 0.35])
    assert np.all(np.abs(away) <= box)
    assert np.all(np.ptp(away, axis=0) > 0.8 * box)


def test_the_tool_reaches_a_quarter_metre_per_second_and_no_more(tour: RecordedPath, robot: Robot) -> None:
    speed = np.linalg.norm(np.diff(tool(robot, tour), axis=0), axis=1) / TICK
    assert 0.245 < speed.max() <= 0.25
    rests = np.flatnonzero(np.diff((speed < 1e-3).astype(int)) == 1)
    assert len(rests) >= 8  # it rests at the instruments


def test_limits_and_accelerations_leave_room(tour: RecordedPath, robot: Robot) -> None:
    q = np.array([tour.at(t) for t in np.arange(0.0, tour.duration, TICK)])
    assert np.all(q > robot.lower)
    assert np.all(q < robot.upper)
    acceleration = np.abs(np.diff(q, 2, axis=0)) / TICK**2
    assert np.all(acceleration.max(axis=0) < 0.5 * robot.acceleration)
