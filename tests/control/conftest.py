"""The demo cell's follower and leader, and a closed loop of the follower alone: no gate, no daemon."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from armgate.cell.cell import Cell, Robot, build_cell
from armgate.cell.config import load_config
from armgate.control.bounds import IncrementBounds
from armgate.control.follower import Follower, FollowStep, Situation
from armgate.control.law import CameraLaw
from armgate.control.predict import ramp_lag
from armgate.control.repulsion import Obstacles
from armgate.control.spheres import Spheres
from armgate.control.view import view_errors

DEMO = Path(__file__).parents[2] / "configs" / "demo.yaml"
Path3 = Callable[[float], np.ndarray]


@pytest.fixture(scope="session")
def cell() -> Cell:
    return build_cell(load_config([DEMO]))


@pytest.fixture(scope="session")
def fr(cell: Cell) -> Robot:
    return cell.robot("FR")


@pytest.fixture(scope="session")
def law(fr: Robot) -> CameraLaw:
    return CameraLaw(fr.model, "camera")


@pytest.fixture(scope="session")
def bounds(fr: Robot) -> IncrementBounds:
    return bounds_of(fr)


def bounds_of(robot: Robot) -> IncrementBounds:
    return IncrementBounds.from_rates(
        lower=robot.lower,
        upper=robot.upper,
        velocity=robot.velocity,
        acceleration=robot.acceleration,
        deceleration=robot.deceleration,
        period=robot.period,
    )


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
        """Sums of sines inside the demo's focus box, at most `speed` m/s fast."""
        rng = np.random.default_rng(seed)
        middle, half = np.array([2.0, 0.0, 1.0]), np.array([0.3, 0.7, 0.35])
        rate, phase = rng.uniform(0.4, 1.6, (3, 3)), rng.uniform(0.0, 2.0 * np.pi, (3, 3))
        share = rng.uniform(0.3, 1.0, (3, 3))
        share *= half[:, None] / share.sum(axis=1, keepdims=True)
        times = np.linspace(0.0, 200.0, 20001)[:, None, None]
        velocities = (share * rate * np.cos(rate * times + phase)).sum(axis=2)
        fastest = np.linalg.norm(velocities, axis=1).max()
        return lambda t: middle + (share * np.sin(rate * (speed / fastest * t) + phase)).sum(axis=1)


@pytest.fixture(scope="session")
def leader(cell: Cell) -> Leader:
    return Leader(cell.robot("GR"))


@dataclass
class Trace:
    angle: np.ndarray  # rad, measured
    distance: np.ndarray  # m, measured error
    q: np.ndarray
    steps: list[FollowStep]


@dataclass
class Loop:
    """The follower against an ideal robot with bounded acceleration and a first-order lag.

    From measuring the leader to moving it takes two ticks: one to hear of it, one to move.
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
    ) -> Trace:
        T, robot = self.robot.period, self.robot
        follower = Follower(self.law, bounds_of(robot), period=T, ahead=T + ramp_lag(lag, T), predict=predict)
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
        """The robot would clamp these; the follower must not let it come to that."""
        T, robot = self.robot.period, self.robot
        assert (np.abs(dq) <= robot.velocity * T).all()
        assert (np.abs(dq - last) <= robot.acceleration * T * T).all()
        assert (setpoint + dq <= robot.upper).all()
        assert (setpoint + dq >= robot.lower).all()


@pytest.fixture
def loop(fr: Robot, leader: Leader, law: CameraLaw) -> Loop:
    return Loop(fr, leader, law)


def random_q(robot: Robot, seed: int, inside: float = 0.8) -> np.ndarray:
    rng = np.random.default_rng(seed)
    middle, half = 0.5 * (robot.upper + robot.lower), 0.5 * (robot.upper - robot.lower)
    return middle + inside * half * rng.uniform(-1.0, 1.0, len(middle))


@pytest.fixture(params=range(8))
def q(request: pytest.FixtureRequest, fr: Robot) -> np.ndarray:
    return random_q(fr, request.param)


def slope(function: Callable[[np.ndarray], object], at: np.ndarray, h: float = 1e-6) -> np.ndarray:
    """Central differences of a function, its arguments along the last axis."""
    ends = [(np.asarray(function(at + h * e)), np.asarray(function(at - h * e))) for e in np.eye(len(at))]
    columns = [(ahead - behind) / (2.0 * h) for ahead, behind in ends]
    return np.moveaxis(np.array(columns), 0, -1)


@pytest.fixture
def differences() -> Callable[..., np.ndarray]:
    return slope
