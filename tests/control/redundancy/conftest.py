"""Planar arms with any link lengths, a branching robot, and tasks of many robots at random positions."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from armgate.cell.cell import Cell
from armgate.cell.model import RobotModel
from armgate.cell.placement import Placement
from armgate.control.redundancy.tasks import FrameTask

CONFIGS = Path(__file__).parents[3] / "configs"

BRANCHES = """
<robot name="branches">
  <link name="base"/> <link name="trunk"/> <link name="left"/> <link name="slide"/>
  <link name="tip"/> <link name="right"/>
  <joint name="J1" type="revolute"><parent link="base"/><child link="trunk"/><origin xyz="0 0 0.3"/>
    <axis xyz="0 0.6 0.8"/><limit lower="-2" upper="2" velocity="1" effort="0"/></joint>
  <joint name="J2" type="revolute"><parent link="trunk"/><child link="left"/>
    <origin xyz="0.4 0 0" rpy="0.3 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" velocity="1" effort="0"/></joint>
  <joint name="J3" type="prismatic"><parent link="left"/><child link="slide"/><origin xyz="0.2 0.1 0"/>
    <axis xyz="1 0 0"/><limit lower="0" upper="0.5" velocity="1" effort="0"/></joint>
  <joint name="J4" type="revolute"><parent link="slide"/><child link="tip"/><origin xyz="0.1 0 0.1"/>
    <axis xyz="0 0 1"/><limit lower="-2" upper="2" velocity="1" effort="0"/></joint>
  <joint name="J5" type="revolute"><parent link="trunk"/><child link="right"/><origin xyz="-0.4 0 0"/>
    <axis xyz="1 0 0"/><limit lower="-2" upper="2" velocity="1" effort="0"/></joint>
</robot>
"""


def planar(*lengths: float) -> RobotModel:
    """Return the lecture's planar arm: parallel axes, links along x at zero; its last frame is `tip`."""
    links = "".join(f'<link name="link_{i}"/>' for i in range(len(lengths) + 1)) + '<link name="tip"/>'
    joints = ""
    for i, offset in enumerate([0.0, *lengths[:-1]]):
        joints += (
            f'<joint name="J{i + 1}" type="revolute"><parent link="link_{i}"/><child link="link_{i + 1}"/>'
            f'<origin xyz="{offset} 0 0"/><axis xyz="0 0 1"/>'
            '<limit lower="-3.1" upper="3.1" velocity="1" effort="0"/></joint>'
        )
    joints += (
        f'<joint name="end" type="fixed"><parent link="link_{len(lengths)}"/><child link="tip"/>'
        f'<origin xyz="{lengths[-1]} 0 0"/></joint>'
    )
    return RobotModel.from_urdf(f'<robot name="planar">{links}{joints}</robot>', Placement.identity())


def planar_jacobian(lengths: tuple[float, ...], q: np.ndarray) -> np.ndarray:
    """Return the lecture's J (slides 6 and 26) for any number of links, (2, n)."""
    angles = np.cumsum(q)
    link = np.array(lengths)
    x, y = link * np.cos(angles), link * np.sin(angles)
    rows = [[-y[j:].sum(), x[j:].sum()] for j in range(len(lengths))]
    return np.array(rows).T


@dataclass
class Case:
    """Task, and positions within its robot's limits."""

    task: FrameTask
    rng: np.random.Generator

    @property
    def model(self) -> RobotModel:
        return self.task.model

    def q(self) -> np.ndarray:
        low, high = self.model.lower, self.model.upper
        return self.rng.uniform(0.95 * low + 0.05 * high, 0.05 * low + 0.95 * high)


CASES = {
    "planar-xy": ("P", "tool0", ("x", "y")),
    "planar-x": ("P", "tool0", ("x",)),
    "arm-xyz": ("FR", "tool0", ("x", "y", "z")),
    "arm-all": ("FR", "tool0", ("x", "y", "z", "rx", "ry", "rz")),
    "gantry-xyz": ("GR", "tool0", ("x", "y", "z")),
    "gantry-all": ("GR", "tool0", ("x", "y", "z", "rx", "ry", "rz")),
    "branches-xz": ("branches", "tip", ("x", "z")),
    "branches-turn": ("branches", "tip", ("rx", "ry", "rz")),
    "fewer-joints": ("branches", "right", ("x", "y", "z")),
}


@pytest.fixture(scope="session")
def models(cell: Cell) -> dict[str, RobotModel]:
    three = (CONFIGS / "robots" / "planar3.urdf").read_text()
    return {
        "P": RobotModel.from_urdf(three, Placement.from_rpy([0.0, 0.0, 0.5], [0.0, 0.0, 0.0])),
        "branches": RobotModel.from_urdf(BRANCHES, Placement.from_rpy([0.1, 0.2, 0.3], [0.4, 0.5, 0.6])),
        **{robot.name: robot.model for robot in cell.robots},
    }


@pytest.fixture(params=CASES)
def case(request: pytest.FixtureRequest, models: dict[str, RobotModel]) -> Case:
    robot, frame, rows = CASES[request.param]
    return Case(
        FrameTask(models[robot], frame, rows), np.random.default_rng(list(CASES).index(request.param))
    )


@pytest.fixture(params=["planar-xy", "arm-xyz", "gantry-all", "branches-xz"])
def redundant(request: pytest.FixtureRequest, models: dict[str, RobotModel]) -> Case:
    """Return a task with redundant joints."""
    robot, frame, rows = CASES[request.param]
    return Case(FrameTask(models[robot], frame, rows), np.random.default_rng(17))


@pytest.fixture(params=range(12))
def J(request: pytest.FixtureRequest) -> np.ndarray:
    """Return a random matrix; the shapes differ, and every third matrix is rank-deficient."""
    rng = np.random.default_rng(request.param)
    m, n = [(2, 3), (3, 6), (6, 6), (6, 9), (1, 4), (6, 3)][request.param % 6]
    whole = rng.normal(size=(m, n))
    return whole if request.param % 3 else rng.normal(size=(m, 1)) @ rng.normal(size=(1, n))


@pytest.fixture
def arm():
    """Return a factory of the lecture's planar arm from its link lengths."""
    return planar


@pytest.fixture
def printed_jacobian():
    """Return the lecture's Jacobian of such an arm."""
    return planar_jacobian
