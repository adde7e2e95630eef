"""The follower's loop: its target, its signals, and its end."""

import json
import os
import signal
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from armgate.apps.default_files import default_file
from armgate.apps.errors import UsageError
from armgate.apps.follow.loop import FollowLoop, FollowOptions
from armgate.apps.follow.program import FollowProgram, Progress, changes
from armgate.apps.follow.proximity import Proximity, RobotBodies
from armgate.apps.interrupt import Interrupt, catch_interrupt
from armgate.apps.robot_models import floor_of
from armgate.cell.cell import Cell as BuiltCell
from armgate.cell.cell import Robot, build_cell
from armgate.cell.config import load_config
from armgate.client import Description, Entry, Nearest, Refused, Tick
from armgate.client.program import Outcome, run_held
from armgate.client.shared_signals import SharedSignals
from armgate.client.tick import State
from armgate.control.near_bodies import NearPair
from armgate.protocol.messages import Error

T = 0.012


@pytest.fixture(scope="module")
def built() -> BuiltCell:
    return build_cell(load_config([default_file("demo.yaml")]))


def described(robot: Robot) -> dict[str, Any]:
    joints = [
        {
            "name": joint.name, "kind": joint.kind, "unit": "rad" if joint.kind == "revolute" else "m",
            "lower": robot.lower[j], "upper": robot.upper[j], "velocity": robot.velocity[j],
            "acceleration": robot.acceleration[j], "deceleration": robot.deceleration[j],
        }
        for j, joint in enumerate(robot.model.joints)
    ]  # fmt: skip
    base = robot.config.base.placement
    return {
        "name": robot.name, "urdf": {"hash": "0" * 64, "size": 1, "media": "x"}, "joints": joints,
        "base_xyz": list(base.t), "base_xyzw": list(base.xyzw()), "period": T, "start": list(robot.start),
        "frames": ["tool0"], "tool": robot.tool, "camera": robot.camera,
    }  # fmt: skip


class Connection:
    """Connection that describes a cell and records shared signals."""

    def __init__(self, built: BuiltCell, **body: Any) -> None:
        floor = {
            "name": "floor", "robot": None, "link": None, "shape": {"kind": "box", "size": [8.0, 7.0, 0.2]},
            "xyz": [1.5, 0.0, -0.1], "xyzw": [0.0, 0.0, 0.0, 1.0], **body,
        }  # fmt: skip
        text = {
            "name": "demo", "hash": "0" * 64, "stop_distance": 0.05, "self_distance": 0.02,
            "response": "stop", "lockstep": True, "bodies": [floor],
            "robots": [described(robot) for robot in built.robots],
        }  # fmt: skip
        self.description = Description.model_validate_json(json.dumps(text, default=float))
        self.built = built
        self.shared: list[tuple[str, Any]] = []
        self.lines: list[str] = []
        self.refusal: Refused | None = None

    def urdf(self, name: str) -> str:
        return self.built.robot(name).urdf

    def signal(self, name: str, value: Any, *, more: bool = False) -> None:
        if self.refusal is not None:
            raise self.refusal
        self.shared.append((name, value))


class HeldRobot:
    """Robot FR without lag; GR stands still, except for a motion from tick 20 to 40."""

    def __init__(self, built: BuiltCell, progress: Any, zoom: Any = None) -> None:
        self.q, self.leader = built.robot("FR").start.copy(), built.robot("GR").start.copy()
        self.progress, self.zoom = progress, zoom or (lambda tick: None)
        self.sent: list[np.ndarray] = []
        self.owner = "l"

    def ticks(self) -> Any:
        for tick in range(2000):
            self.leader[1] += 0.003 if 20 <= tick < 40 else 0.0
            yield Tick("FR", self.state(tick))
        raise AssertionError("never ended")

    def state(self, tick: int) -> State:
        common = {"tick": tick, "time": T * tick}
        shared = {"lead.progress": self.progress(tick), "operator.distance": self.zoom(tick)}
        signals = {
            name: {"owner": self.owner, "value": (value,), "time": 0.0}
            for name, value in shared.items()
            if value is not None
        }
        q, leader = tuple(self.q.tolist()), tuple(self.leader.tolist())
        entries = (
            {"robot": "FR", "q": q, "setpoint": q, **common},
            {"robot": "GR", "q": leader, "holder": "l", **common},
        )
        return State.model_validate({"robot": "FR", "entries": entries, "signals": signals, **common})

    def send(self, dq: list[float]) -> None:
        self.sent.append(np.array(dq))
        self.q = self.q + dq


def followed(
    built: BuiltCell,
    progress: Any,
    interrupt: Interrupt | None = None,
    duration: float | None = None,
    zoom: Any = None,
    owner: str = "l",
) -> Any:
    cell, robot = Connection(built), HeldRobot(built, progress, zoom)
    robot.owner = owner
    program = FollowProgram.build(cell, "FR", "GR", FollowOptions(1.0, 0.0), duration)
    sharing = SharedSignals(cell, cell.lines.append)
    ended = run_held(robot, program, sharing, interrupt)  # type: ignore[arg-type]
    return ended, cell, robot


def test_the_follower_follows_until_the_path_ends_within_its_bounds(built: BuiltCell) -> None:
    ended, cell, robot = followed(built, lambda tick: min(1.0, tick / 150))
    assert ended == Outcome("the leader's path is finished, at rest")
    angles = [value[0] for name, value in cell.shared if name == "follow.angle_error"]
    assert angles[-1] < np.radians(0.05)
    own = built.robot("FR")
    u = np.array(robot.sent)
    assert np.all(np.abs(u) <= own.velocity * T)
    assert np.all(np.abs(np.diff(u, axis=0)) <= own.acceleration * T * T)
    np.testing.assert_array_equal(u[-1], 0.0)


POINTS = ((0.2, -0.25, 1.0), (0.2, -0.4, 1.0))
NEAR = {"pair": ("GR/link_6", "FR/link_3"), "distance": 0.15, "limit": 0.05, "points": POINTS[::-1]}


def proximity(built: BuiltCell, near: dict[str, Any], end: float = 0.0) -> tuple[NearPair, ...]:
    """Return the near pairs if the leader's stop ends ``end`` further along y."""
    fr, gr = built.robot("FR"), built.robot("GR")
    stop = np.array(gr.start)
    stop[1] += end
    entries = (
        Entry(robot="FR", tick=0, time=0.0, nearest=(Nearest.model_validate(near),)),
        Entry(robot="GR", tick=0, time=0.0, q=tuple(gr.start.tolist()), stop_end=tuple(stop.tolist())),
    )
    return Proximity(RobotBodies.of("FR", fr.model), RobotBodies.of("GR", gr.model)).pairs(*entries)


def test_a_near_pair_has_the_room_left_by_the_leaders_stop(built: BuiltCell) -> None:
    (pair,) = proximity(built, NEAR)
    np.testing.assert_array_equal(pair.points, POINTS)
    assert (pair.joint, pair.room) == (2, pytest.approx(0.1))
    (nearer,) = proximity(built, NEAR, end=0.04)
    assert nearer.room == pytest.approx(0.06)
    (leaving,) = proximity(built, NEAR, end=-0.04)
    assert leaving.room == pytest.approx(0.1)


@pytest.mark.parametrize(
    "other",
    [
        {"pair": ("FR/link_3", "floor")},
        {"pair": ("FR/link_2", "FR/link_5")},
        {"pair": ("GR/link_6", "FR/base_link")},
        {"points": None},
        {"distance": 0.3},
    ],
)
def test_pairs_of_other_bodies_are_ignored(built: BuiltCell, other: dict[str, Any]) -> None:
    assert proximity(built, NEAR | other) == ()


def test_the_follower_shares_its_measured_errors(built: BuiltCell) -> None:
    _, cell, robot = followed(built, lambda tick: None, duration=1.0)
    names = {name for name, _ in cell.shared}
    assert names == {
        f"follow.{x}"
        for x in (
            "angle_error",
            "distance_error",
            "focus",
            "distance",
            "repulsion",
            "emergency",
            "near_limit",
        )
    }
    newest = dict(cell.shared)
    camera = built.robot("FR").model.frame(robot.q, "camera")
    tool = built.robot("GR").model.frame(robot.leader, "tool0").t
    np.testing.assert_allclose(newest["follow.focus"], tool, atol=1e-12)
    distance = float(np.linalg.norm(tool - camera.t)) - 1.0
    assert newest["follow.distance_error"][0] == pytest.approx(distance, abs=1e-6)


@pytest.mark.parametrize("invalid", [0.0, -1.0, 0.049, 1e300])
def test_a_distance_out_of_range_keeps_the_last_one(built: BuiltCell, invalid: float) -> None:
    zooms = [None, 1.1, invalid, 1.2, None]
    _, cell, _ = followed(built, lambda tick: None, duration=0.6, zoom=lambda tick: zooms[min(tick // 10, 4)])
    assert [value[0] for name, value in cell.shared if name == "follow.distance"] == [1.0, 1.1, 1.2, 1.0]


def test_duration_and_interrupt_end_the_follower(built: BuiltCell) -> None:
    ended, _, robot = followed(built, lambda tick: None, duration=0.6)
    assert ended == Outcome("duration has passed, at rest")
    assert 50 <= len(robot.sent) < 150
    interrupt = Interrupt()
    interrupt.requested = True
    assert followed(built, lambda tick: 0.0, interrupt)[0] == Outcome("interrupted, at rest")


def test_a_leader_that_disconnects_early_is_reported_after_the_follower_is_at_rest(built: BuiltCell) -> None:
    ended, _, robot = followed(built, lambda tick: tick / 100 if tick < 30 else None)
    assert ended == Outcome("FR is at rest: the leader disconnected at 29 % of its path", failed=True)
    np.testing.assert_array_equal(robot.sent[-1], 0.0)


def shared(owner: str, value: float) -> Any:
    return SimpleNamespace(owner=owner, value=(value,))


def test_a_progress_shared_before_the_leader_connects_is_ignored() -> None:
    watched = Progress()
    assert watched.ending(None, None) is None
    assert not watched.left


def test_only_the_holder_of_the_leaders_robot_sets_the_progress(built: BuiltCell) -> None:
    watched = Progress()
    for foreign in (0.5, 1.0, 1e300):
        assert watched.ending(shared("stranger", foreign), "leader") is None
    assert watched.ending(shared("stranger", 1.0), None) is None
    assert watched.ending(shared("leader", 0.4), "leader") is None
    assert watched.ending(shared("leader", 0.5), None) is None  # it has just released its robot
    assert (watched.value, watched.left) == (0.5, False)
    assert watched.ending(shared("stranger", 1.0), None) == "the leader has disconnected"
    assert watched.left
    ended, _, _ = followed(built, lambda tick: 1.0, duration=0.6, owner="stranger")
    assert ended == Outcome("duration has passed, at rest")


@pytest.mark.parametrize("invalid", [-1.0, 1.0000001, 1e300])
def test_a_progress_out_of_range_keeps_the_last_one(invalid: float) -> None:
    watched = Progress()
    assert watched.ending(shared("leader", 0.4), "leader") is None
    assert watched.ending(shared("leader", invalid), "leader") is None
    assert watched.value == 0.4
    assert watched.ending(shared("leader", 1.0), "leader") == "the leader's path is finished"


@pytest.mark.parametrize("code", ["signal_owned", "too_many_signals", "forbidden"])
def test_refused_signals_are_reported_once_and_end_no_motion(built: BuiltCell, code: str) -> None:
    cell, robot = Connection(built), HeldRobot(built, lambda tick: None)
    cell.refusal = Refused(Error(code=code, text="no", fatal=False))
    program = FollowProgram.build(cell, "FR", "GR", FollowOptions(1.0, 0.0), 0.6)
    sharing = SharedSignals(cell, cell.lines.append)
    ended = run_held(robot, program, sharing)  # type: ignore[arg-type]
    assert ended == Outcome("duration has passed, at rest")
    (line,) = cell.lines
    assert line.startswith("some signals are not shared")


def test_unsuitable_robots_are_named(built: BuiltCell) -> None:
    cell: Any = Connection(built)
    with pytest.raises(UsageError, match="no robot 'XR'; it has FR, GR"):
        FollowLoop.build(cell, "XR", "GR", FollowOptions(1.0, 0.0))
    with pytest.raises(UsageError, match="robot 'GR' has no camera"):
        FollowLoop.build(cell, "GR", "FR", FollowOptions(1.0, 0.0))
    with pytest.raises(UsageError, match="cannot follow itself"):
        FollowLoop.build(cell, "FR", "FR", FollowOptions(1.0, 0.0))


def test_the_floor_is_the_top_of_a_level_box(built: BuiltCell) -> None:
    assert floor_of(Connection(built).description) == pytest.approx(0.0)
    assert floor_of(Connection(built, name="table").description) is None
    tilted = Connection(built, xyzw=[0.1, 0.0, 0.0, 0.995])
    assert floor_of(tilted.description) is None


def test_only_changed_values_are_shared() -> None:
    assert changes({"a": (1.0,), "b": (2.0,)}, {}) == {"a": (1.0,), "b": (2.0,)}
    assert changes({"a": (1.0,), "b": (3.0,)}, {"a": (1.0,), "b": (2.0,)}) == {"b": (3.0,)}


def test_the_first_interrupt_sets_a_flag() -> None:
    with catch_interrupt() as interrupt:
        os.kill(os.getpid(), signal.SIGTERM)
        assert interrupt.requested
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
