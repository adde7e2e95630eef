"""The loop of ``reach``: its goal, its end, and its increments."""

import math
import re
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from armgate.apps.errors import UsageError
from armgate.apps.interrupt import Interrupt
from armgate.apps.lead.path import read_path
from armgate.apps.reach.goal import GAINS, Arm, Goal, away_from_surroundings, build, target
from armgate.apps.reach.program import EndCriteria, ReachProgram, Steps, write_motion
from armgate.cell.cell import Cell, build_cell
from armgate.cell.config import load_config
from armgate.cell.placement import Placement, rotation_from_rpy
from armgate.client import Description
from armgate.client.program import Outcome, run_held
from armgate.client.shared_signals import SharedSignals
from armgate.control.bounds import IncrementBounds
from armgate.control.redundancy.reach import Reach, Tuning

CONFIGS = Path(__file__).parents[2] / "configs"
T = 0.012


@pytest.fixture(scope="module")
def planar() -> Cell:
    return build_cell(load_config([CONFIGS / "planar.yaml"]))


@pytest.fixture(scope="module")
def connected(planar: Cell) -> Any:
    """Return a connection with the description of the planar cell and its URDF."""
    robot = planar.robots[0]
    joints = [
        {
            "name": j.name, "kind": j.kind, "unit": "rad", "lower": j.lower, "upper": j.upper,
            "velocity": j.velocity, "acceleration": 4 * j.velocity, "deceleration": 4 * j.velocity,
        }
        for j in robot.model.joints
    ]  # fmt: skip
    bodies = [
        {
            "name": body.name, "robot": None, "link": None, "xyz": tuple(body.placement.t.tolist()),
            "xyzw": body.placement.xyzw(), "shape": {"kind": body.shape.kind, "size": body.shape.size},
        }
        for body in planar.surroundings
    ]  # fmt: skip
    description = Description.model_validate(
        {
            "name": "planar", "hash": "0" * 64, "stop_distance": 0.02, "self_distance": 0.01,
            "response": "stop", "lockstep": True, "bodies": tuple(bodies),
            "robots": (
                {
                    "name": "P", "urdf": {"hash": "0" * 64, "size": 1, "media": "application/xml"},
                    "joints": tuple(joints), "base_xyz": (0.0, 0.0, 0.5), "base_xyzw": (0.0, 0.0, 0.0, 1.0),
                    "period": T, "start": tuple(robot.start.tolist()), "frames": ("tool0",),
                    "tool": "tool0", "camera": None,
                },
            ),
        }
    )  # fmt: skip
    return SimpleNamespace(description=description, urdf=lambda _name: robot.urdf)


def goal(**change: Any) -> Goal:
    values = {
        "frame": None, "rows": ("x", "y"), "xyz": (0.3, 0.7, 0.5), "rpy_deg": None, "tuning": Tuning(),
        "objectives": (), "clear": 0.3, **change,
    }  # fmt: skip
    return Goal(**values)


class HeldRobot:
    """Robot that plays the increments that it receives, one per tick; ``admit`` may change them."""

    def __init__(self, q: np.ndarray, admit: Any = lambda dq: dq) -> None:
        self.setpoint, self.admit, self.sent = q, admit, []

    def ticks(self) -> Iterator[Any]:
        for tick in range(6000):
            yield SimpleNamespace(tick=tick, time=T * tick, setpoint=tuple(self.setpoint.tolist()))
        raise AssertionError("never ended")

    def send(self, dq: list[float]) -> Any:
        self.sent.append(np.array(dq))
        admitted = self.admit(np.array(dq))
        self.setpoint = self.setpoint + admitted
        free = np.array_equal(admitted, dq)
        reasons = () if free else (SimpleNamespace(text="a post is in the way"),)
        return SimpleNamespace(outcome="admitted" if free else "refused", reasons=reasons)


class SignalLog:
    def __init__(self) -> None:
        self.errors: list[float] = []

    def signal(self, name: str, value: float, *, more: bool = False) -> None:
        assert name == "reach.error"
        self.errors.append(value)


def go(
    arm: Arm, held: HeldRobot, *, duration: float = 30.0, interrupt: Interrupt | None = None
) -> tuple[Outcome, SignalLog, ReachProgram]:
    log, program = SignalLog(), ReachProgram(arm, EndCriteria(1e-3, duration))
    sharing = SharedSignals(log, lambda line: None)
    return run_held(held, program, sharing, interrupt), log, program  # type: ignore[arg-type]


START = np.radians([0.0, 45.0, 45.0])


def test_reach_reaches_the_target_within_the_bounds_and_rests(connected: Any) -> None:
    arm = build(connected, "P", goal())
    held = HeldRobot(START)
    done, log, program = go(arm, held)
    assert done.text.startswith("target reached in ")
    assert not done.failed
    assert log.errors[0] > 0.4
    assert log.errors[-1] < 1e-3
    sent = np.array(held.sent)
    assert (np.abs(sent) <= arm.bounds.step).all()
    assert (np.abs(np.diff(sent, axis=0)) <= arm.bounds.change + 1e-12).all()
    np.testing.assert_allclose(sent[-1], 0.0, atol=1e-9)
    assert len(program.setpoints) > 100


def test_without_a_target_the_frame_stays_while_an_objective_moves_the_arm(connected: Any) -> None:
    arm = build(connected, "P", goal(xyz=None, objectives=("limits",)))
    done, log, program = go(arm, HeldRobot(START))
    assert not done.failed
    assert max(log.errors) < 1e-3
    assert np.abs(program.setpoints[-1] - START).max() > 0.05
    assert np.sum(program.setpoints[-1] ** 2) < np.sum(START**2)


def test_a_refused_robot_is_stuck_and_the_reason_is_reported(connected: Any) -> None:
    arm = build(connected, "P", goal())
    done, *_ = go(arm, HeldRobot(START, admit=np.zeros_like))
    assert done.failed
    assert re.fullmatch("stuck .* a post is in the way, at rest", done.text)


def test_a_target_out_of_reach_is_reported_as_stuck(connected: Any) -> None:
    done, *_ = go(build(connected, "P", goal(xyz=(3.0, 0.0, 0.5))), HeldRobot(START))
    assert done.failed
    assert done.text.startswith("stuck 1.8")


def test_the_motion_ends_after_its_duration(connected: Any) -> None:
    done, *_ = go(build(connected, "P", goal()), HeldRobot(START), duration=0.5)
    assert (done.failed, done.text.startswith("timeout")) == (True, True)


def test_an_interrupted_robot_comes_to_rest_and_the_command_has_not_failed(connected: Any) -> None:
    interrupt, held = Interrupt(), HeldRobot(START)

    def admit(dq: np.ndarray) -> np.ndarray:
        interrupt.requested = len(held.sent) > 50
        return dq

    held.admit = admit
    done, *_ = go(build(connected, "P", goal()), held, interrupt=interrupt)
    assert done == Outcome("interrupted, at rest")
    assert np.abs(held.sent[49]).max() > 1e-3
    np.testing.assert_array_equal(held.sent[-1], 0.0)


def test_the_motion_continues_until_the_objectives_settle() -> None:
    criteria = EndCriteria(tolerance=1e-3, duration=60.0)
    assert [criteria.update(0.1 * k, 0.0, 0.5) for k in range(100)] == [None] * 100
    ends = [criteria.update(10.0 + 0.1 * k, 0.0, 0.0) for k in range(5)]
    assert ends[0] is None
    assert ends[-1] == ("target reached in 10.40 s, 0.0e+00 left", True)


def test_slow_progress_continues_and_no_progress_is_stuck() -> None:
    criteria = EndCriteria(tolerance=1e-3, duration=1000.0)
    assert all(criteria.update(2.9 * k, 1.0 - 2e-3 * k, 0.5) is None for k in range(100))
    stuck = [criteria.update(2.9 * 99 + t, 0.8015, 0.5) for t in (2.9, 3.1)]
    assert stuck == [None, ("stuck 0.8015 from the target after 290.20 s", False)]


def test_a_fast_request_is_scaled_as_a_whole() -> None:
    bounds = IncrementBounds.from_rates(
        lower=[-9, -9], upper=[9, 9], velocity=[1, 2], acceleration=[1e6, 1e6], period=T
    )
    dq = Steps(bounds, T).increment(np.array([10.0, 10.0]), np.zeros(2), np.zeros(2))
    np.testing.assert_allclose(dq, [T, T], rtol=1e-5)
    np.testing.assert_allclose(
        Steps(bounds, T).increment(np.array([0.5, 0.1]), np.zeros(2), np.zeros(2)), [0.5 * T, 0.1 * T]
    )


def test_targets_keep_unspecified_parts() -> None:
    here = Placement.from_rpy([1.0, 2.0, 3.0], [0.1, 0.2, 0.3])
    stays = target(goal(xyz=None), here)
    np.testing.assert_array_equal(stays.t, here.t)
    np.testing.assert_array_equal(stays.R, here.R)
    turned = target(goal(xyz=(1.0, 0.0, 0.0), rpy_deg=(90.0, 0.0, 45.0)), here)
    np.testing.assert_array_equal(turned.t, [1.0, 0.0, 0.0])
    np.testing.assert_allclose(turned.R, rotation_from_rpy([math.pi / 2, 0.0, math.pi / 4]))


@pytest.mark.parametrize("name", GAINS)
def test_every_objective_moves_the_arm_in_the_null_space(connected: Any, name: str) -> None:
    q = np.array([0.6, 0.4, 0.7])
    arm = build(connected, "P", goal(xyz=None, objectives=(name,), clear=1.0))
    controller = arm.controller(q)
    assert isinstance(controller, Reach)
    qd = controller.velocity(q).qd
    assert np.linalg.norm(qd) > 1e-3
    assert np.abs(controller.task.jacobian(q) @ qd).max() < 1e-10


def test_obstacles_are_the_surroundings_at_their_places(connected: Any, planar: Cell) -> None:
    """Check the arm along x and −x: it is 1.2 m long, and the face of the beam is at x = −0.85 m."""
    objective = away_from_surroundings(planar.robots[0].model, connected.description, 0.3)
    assert objective.least_distance(np.zeros(3)) == pytest.approx(0.5 - 0.05 - 0.04, abs=0.02)
    assert objective.least_distance(np.array([math.pi, 0.0, 0.0])) < 0.0


@pytest.mark.parametrize(
    ("robot", "change", "text"),
    [
        ("XR", {}, "no robot 'XR'; it has P"),
        ("P", {"frame": "nose"}, "there is no frame 'nose'"),
        ("P", {"rows": ("x", "w")}, "rows 'x,w'; expected some of x, y, z, rx, ry, rz"),
    ],
)
def test_options_that_do_not_fit_the_cell_are_wrong_usage(
    connected: Any, robot: str, change: dict[str, Any], text: str
) -> None:
    with pytest.raises(UsageError, match=text):
        build(connected, robot, goal(**change))


def test_the_motion_is_written_as_a_path_that_can_be_read(connected: Any, tmp_path: Path) -> None:
    robot = connected.description.robots[0]
    q = np.random.default_rng(0).normal(size=(50, 3))
    write_motion(tmp_path / "p.csv", robot, q)
    path = read_path(tmp_path / "p.csv")
    assert (path.robot, path.joints, path.units, path.period) == ("P", ("J1", "J2", "J3"), ("rad",) * 3, T)
    np.testing.assert_allclose(path.q, q, atol=1e-9)
    write_motion(tmp_path / "p.csv", robot, q[:1])
    assert len(read_path(tmp_path / "p.csv").q) == 2
    with pytest.raises(UsageError, match="cannot be written"):
        write_motion(tmp_path / "none" / "p.csv", robot, q)
