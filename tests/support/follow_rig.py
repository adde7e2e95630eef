"""A follower in closed loop with an ideal robot of bounded acceleration and a leader: no gate, no daemon."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from armgate.cell.cell import Robot
from armgate.control.bounds import IncrementBounds
from armgate.control.follower import Follower, FollowStep, Situation
from armgate.control.law import CameraLaw
from armgate.control.predict import ramp_lag
from armgate.control.repulsion import Obstacles
from armgate.control.spheres import Spheres
from armgate.control.view_errors import view_errors

Path3 = Callable[[float], np.ndarray]


@dataclass
class Leader:
    """GR as obstacles: it translates as a whole, so that its tool is at p."""

    robot: Robot

    def __post_init__(self) -> None:
        self.spheres = Spheres.of(self.robot.model)
        self._centres = self.spheres.centres(self.robot.start)
        self._tool = self.robot.model.frame(self.robot.start, self.robot.tool).t

    def obstacles(self, p: np.ndarray) -> Obstacles:
        return Obstacles(self._centres + (p - self._tool), self.spheres.radii, 0.0)

    @staticmethod
    def path(seed: int, speed: float) -> Path3:
        """Return a path of summed sines inside the demo's focus box, at most ``speed`` m/s fast."""
        rng = np.random.default_rng(seed)
        middle, half = np.array([2.0, 0.0, 1.0]), np.array([0.3, 0.7, 0.35])
        rate, phase = rng.uniform(0.4, 1.6, (3, 3)), rng.uniform(0.0, 2.0 * np.pi, (3, 3))
        share = rng.uniform(0.3, 1.0, (3, 3))
        share *= half[:, None] / share.sum(axis=1, keepdims=True)
        times = np.linspace(0.0, 200.0, 20001)[:, None, None]
        velocities = (share * rate * np.cos(rate * times + phase)).sum(axis=2)
        fastest = np.linalg.norm(velocities, axis=1).max()
        return lambda t: middle + (share * np.sin(rate * (speed / fastest * t) + phase)).sum(axis=1)


@dataclass
class Trace:
    angle: np.ndarray  # rad, measured
    distance: np.ndarray  # m, measured error
    q: np.ndarray
    steps: list[FollowStep]


@dataclass
class Loop:
    """The follower against an ideal robot with bounded acceleration and a first-order lag.

    A measurement of the leader takes effect two ticks later: one for the state, one for the command.
    """

    robot: Robot
    leader: Leader
    law: CameraLaw

    def run(
        self,
        path: Path3,
        seconds: float,
        *,
        lag: float = 0.0,
        predict: bool = True,
        start: np.ndarray | None = None,
        wanted: float = 1.0,
        obstacles: Callable[[float], Obstacles] | None = None,
        **options: Any,
    ) -> Trace:
        T, robot = self.robot.period, self.robot
        follower = Follower(
            self.law,
            IncrementBounds.of(robot),
            period=T,
            ahead=T + ramp_lag(lag, T),
            predict=predict,
            **options,
        )
        setpoint = np.array(robot.start if start is None else start)
        q, last, keep = setpoint, np.zeros(robot.model.n), np.exp(-T / lag) if lag else 0.0
        angles, distances, qs, steps = [], [], [], []
        for k in range(round(seconds / T)):
            now, heard = k * T, max(0, k - 1) * T
            angle, distance = view_errors(robot.model, "camera", q, path(now), wanted)
            around = self.leader.obstacles(path(heard)) if obstacles is None else obstacles(heard)
            step = follower.step(Situation(now, setpoint, last, q, path(heard), heard, wanted, around))
            self._check(step.dq, last, setpoint)
            last = step.dq
            setpoint = setpoint + last
            q = setpoint + keep * (q - setpoint)
            angles.append(angle)
            distances.append(distance)
            qs.append(q)
            steps.append(step)
        return Trace(np.array(angles), np.array(distances), np.array(qs), steps)

    def _check(self, dq: np.ndarray, last: np.ndarray, setpoint: np.ndarray) -> None:
        """Check that the increment is within the bounds, so that the robot would not clamp it."""
        T, robot = self.robot.period, self.robot
        assert (np.abs(dq) <= robot.velocity * T).all()
        assert (np.abs(dq - last) <= robot.acceleration * T * T).all()
        assert (setpoint + dq <= robot.upper).all()
        assert (setpoint + dq >= robot.lower).all()


def still(p: object) -> Path3:
    """Return the path of a target that rests at p."""
    return lambda _: np.array(p)


def approach_starts(robot: Robot, count: int, p: np.ndarray, seed: int = 5) -> list[np.ndarray]:
    """Return starting positions clear of the floor, with the target p 30° to 150° off the view axis."""
    rng, starts, spheres = np.random.default_rng(seed), [], Spheres.of(robot.model)
    while len(starts) < count:
        q = robot.start + rng.uniform(-1.0, 1.0, 6) * [2.6, 0.7, 0.8, 2.5, 1.6, 2.5]
        half = 0.5 * (robot.upper - robot.lower)
        if (np.abs(q - 0.5 * (robot.upper + robot.lower)) > 0.95 * half).any():
            continue
        angle = np.degrees(view_errors(robot.model, "camera", q, p, 1.0)[0])
        if 30.0 < angle < 150.0 and spheres.centres(q)[:, 2].min() > 0.2:
            starts.append(q)
    return starts


def dash(place: np.ndarray, seed: int, speed: float) -> Path3:
    """Return the path of a tool that moves straight to a place from 2.5 m away and stays there."""
    rng = np.random.default_rng(seed)
    while True:
        u = rng.normal(size=3)
        u /= np.linalg.norm(u)
        if u[0] > 0.3 and u[2] > -0.1:
            return lambda t: place + u * max(2.5 - speed * t, 0.0)
