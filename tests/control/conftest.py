"""The demo cell's follower and leader, and a closed loop of the follower alone."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from armgate.cell.cell import Cell, Robot, build_cell
from armgate.cell.config import load_config
from armgate.control.bounds import IncrementBounds
from armgate.control.compiled import CompiledLaw
from armgate.control.law import CameraLaw
from support.follow_rig import Leader, Loop

DEMO = Path(__file__).parents[2] / "configs" / "demo.yaml"


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
def fast(fr: Robot) -> CompiledLaw:
    """Return the same law, compiled: closed loops take a tenth of the time."""
    return CompiledLaw(fr.model, "camera")


@pytest.fixture(scope="session")
def bounds(fr: Robot) -> IncrementBounds:
    return IncrementBounds.of(fr)


@pytest.fixture(scope="session")
def leader(cell: Cell) -> Leader:
    return Leader(cell.robot("GR"))


@pytest.fixture
def loop(fr: Robot, leader: Leader, fast: CompiledLaw) -> Loop:
    return Loop(fr, leader, fast)


def random_q(robot: Robot, seed: int, inside: float = 0.8) -> np.ndarray:
    rng = np.random.default_rng(seed)
    middle, half = 0.5 * (robot.upper + robot.lower), 0.5 * (robot.upper - robot.lower)
    return middle + inside * half * rng.uniform(-1.0, 1.0, len(middle))


@pytest.fixture(params=range(8))
def q(request: pytest.FixtureRequest, fr: Robot) -> np.ndarray:
    return random_q(fr, request.param)


def slope(function: Callable[[np.ndarray], object], at: np.ndarray, h: float = 1e-6) -> np.ndarray:
    """Return central differences of a function, its arguments along the last axis."""
    ends = [(np.asarray(function(at + h * e)), np.asarray(function(at - h * e))) for e in np.eye(len(at))]
    columns = [(ahead - behind) / (2.0 * h) for ahead, behind in ends]
    return np.moveaxis(np.array(columns), 0, -1)


@pytest.fixture
def differences() -> Callable[..., np.ndarray]:
    return slope
