"""The leader's checks before it moves, and the end of its loop."""

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from armgate.apps.errors import PathError, UsageError
from armgate.apps.interrupt import Interrupt
from armgate.apps.last_increment import LastIncrement
from armgate.apps.lead.drive import PathProgram, bounds_of, check_path
from armgate.apps.lead.path import RecordedPath
from armgate.apps.lead.playback import Playback
from armgate.client import Description
from armgate.client.program import run_held
from armgate.client.shared_signals import SharedSignals

T = 0.012


def path_of(q: np.ndarray) -> RecordedPath:
    return RecordedPath(Path("p.csv"), "GR", ("X", "A1", "A2"), ("m", "rad", "rad"), 0.05, q.copy(), 8)


def swing() -> RecordedPath:
    s = (1 - np.cos(np.linspace(0.0, 2 * np.pi, 41))) / 2
    return path_of(np.stack([0.3 * s, 0.2 * s, -0.1 * s], axis=1))


def test_a_path_for_its_robot_is_accepted(description: Description) -> None:
    assert check_path(swing(), description, "GR").name == "GR"


def test_an_unsuitable_path_is_refused_with_the_robot_joint_limit_or_speed(description: Description) -> None:
    with pytest.raises(UsageError, match="no robot 'XR'; it has FR, GR"):
        check_path(swing(), description, "XR")
    with pytest.raises(
        PathError, match=r"is for joints X\[m\] A1\[rad\] A2\[rad\]; FR has A1\[rad\] A2\[rad\]"
    ):
        check_path(swing(), description, "FR")
    q = swing().q.copy()
    q[7, 1] = 3.5
    with pytest.raises(PathError, match=r"p\.csv:15: A1 at 3\.5; expected -3 to 3 rad"):
        check_path(path_of(q), description, "GR")
    q = swing().q.copy()
    q[20:, 0] += 0.2
    with pytest.raises(PathError, match=r"p\.csv:28: X moves at 4.*; expected at most 1 m/s"):
        check_path(path_of(q), description, "GR")


def test_bounds_come_from_the_description(description: Description) -> None:
    robot = description.robots[1]
    free = robot.joints[0].model_copy(update={"deceleration": None})
    bounds = bounds_of(robot.model_copy(update={"joints": (free, *robot.joints[1:])}))
    np.testing.assert_allclose(bounds.velocity, [1.0, 2.7, 2.7])
    assert bounds.deceleration[0] == np.inf
    assert bounds.period == T


class HeldRobot:
    """Robot that plays the increments that it receives, one per tick; ``admit`` may change them."""

    def __init__(self, n: int, admit: Any = lambda dq, _tick: dq) -> None:
        self.setpoint, self.tick, self.admit = np.zeros(n), 0, admit

    def ticks(self) -> Iterator[Any]:
        for self.tick in range(3000):
            yield SimpleNamespace(tick=self.tick, setpoint=tuple(self.setpoint.tolist()))
        raise AssertionError("never ended")

    def send(self, dq: list[float]) -> Any:
        admitted = self.admit(np.array(dq), self.tick)
        self.setpoint = self.setpoint + admitted
        free = np.array_equal(admitted, dq)
        reasons = () if free else (SimpleNamespace(text="a tank is in the way"),)
        return SimpleNamespace(outcome="admitted" if free else "refused", reasons=reasons)


class SignalLog:
    """Connection that records the signals."""

    def __init__(self) -> None:
        self.progress: list[float] = []

    def signal(self, name: str, value: float, *, more: bool = False) -> None:
        assert name == "lead.progress"
        self.progress.append(value)


def driven(
    description: Description, robot: HeldRobot, interrupt: Interrupt | None = None
) -> tuple[str, SignalLog, list[str]]:
    shared, lines = SignalLog(), []
    playback = Playback(swing(), bounds_of(description.robots[1]))
    sharing = SharedSignals(shared, lines.append)
    ended = run_held(robot, PathProgram(playback, lines.append), sharing, interrupt)  # type: ignore[arg-type]
    assert not ended.failed
    return ended.text, shared, lines


def test_the_leader_shares_its_progress_and_ends_at_rest(description: Description) -> None:
    ended, shared, lines = driven(description, HeldRobot(3))
    assert ended == "2.0 s of the path played, at rest"
    assert shared.progress[-1] == 1.0
    assert shared.progress == sorted(shared.progress)
    assert lines == []


def test_the_leader_reports_when_the_gate_delays_its_path(description: Description) -> None:
    blocked = range(60, 160)
    ended, shared, lines = driven(
        description, HeldRobot(3, lambda dq, tick: np.zeros(3) if tick in blocked else dq)
    )
    assert [line.split(" at")[0].split(" from")[0] for line in lines] == ["path held", "path continues"]
    assert "a tank is in the way" in lines[0]
    assert shared.progress[-1] == 1.0
    assert "played" in ended


def test_an_interrupted_leader_comes_to_rest(description: Description) -> None:
    interrupt, robot = Interrupt(), HeldRobot(3)
    speeds: list[float] = []

    def admit(dq: np.ndarray, tick: int) -> np.ndarray:
        interrupt.requested = tick >= 80
        speeds.append(float(np.abs(dq).max()))
        return dq

    robot.admit = admit
    ended, shared, _ = driven(description, robot, interrupt)
    assert ended == "interrupted, at rest"
    assert speeds[79] > 1e-3
    assert speeds[-1] < 1e-6
    assert speeds[80:] == sorted(speeds[80:], reverse=True)
    assert shared.progress[-1] < 1.0


def test_the_played_increment_follows_from_the_setpoints() -> None:
    last = LastIncrement()
    np.testing.assert_array_equal(last.update(5, (1.0, 2.0)), [0.0, 0.0])
    np.testing.assert_allclose(last.update(6, (1.1, 2.0)), [0.1, 0.0])
    np.testing.assert_allclose(last.update(9, (1.4, 1.7)), [0.1, -0.1])
