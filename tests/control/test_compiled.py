"""The compiled law compared with the numpy form over random states."""

import pickle
import subprocess
import sys

import numpy as np
import pytest

from armgate.cell.compilation import available
from armgate.cell.errors import ModelError
from armgate.control.chase import Aim, Motion
from armgate.control.compiled import CompiledLaw, CompiledLeader, camera_law
from armgate.control.gains import Gains
from armgate.control.integrate import Scheme
from armgate.control.law import CameraLaw
from armgate.control.leader import Leader
from armgate.control.repulsion import Obstacles
from armgate.control.weights import LimitRule

GAINS = {
    "default": Gains(),
    "paper, rad": Gains(limits=LimitRule.PAPER_RADIANS),
    "paper, deg": Gains(limits=LimitRule.PAPER_DEGREES),
    "Chan-Dubey": Gains(limits=LimitRule.CHAN_DUBEY),
}


def same(ours, reference):
    """Check equality to 1e-12 of the largest entry: sums in another order differ by rounding."""
    ours, reference = np.asarray(ours), np.asarray(reference)
    np.testing.assert_allclose(ours, reference, rtol=1e-12, atol=1e-12 * max(1.0, np.abs(reference).max()))


def states(robot, count, seed=0):
    """Yield positions over the whole range, targets all around, obstacles far, near and inside."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        q = robot.lower + (robot.upper - robot.lower) * rng.uniform(0.0, 1.0, robot.model.n)
        p = rng.uniform(-2.0, 3.0, 3)
        around = Obstacles(
            rng.uniform(-1.5, 2.5, (6, 3)), rng.uniform(0.05, 0.3, 6), float(rng.choice([0.0, -2.0]))
        )
        yield q, p, rng.uniform(0.3, 2.0), around, rng.normal(size=3)


@pytest.fixture(scope="module", params=GAINS)
def pair(request, fr):
    return tuple(law(fr.model, "camera", GAINS[request.param]) for law in (CameraLaw, CompiledLaw))


def goals(pair, q, p, distance, around, **more):
    return [(law, law.goal(p, distance, law.scene(around, q), **more)) for law in pair]


@pytest.mark.daily(1)
@pytest.mark.parametrize("emergency", [False, True])
def test_f_equals_the_numpy_form(pair, fr, emergency):
    pushed = 0
    for q, p, distance, around, v in states(fr, 100):
        (law, goal), (fast, packed) = goals(pair, q, p, distance, around, emergency=emergency, velocity=v)
        same(fast(q, packed), law(q, goal))
        pushed += goal.scene.gap < law.gains.reach
    assert 20 < pushed < 100


def test_runge_kutta_step_and_task(pair, fr):
    for q, p, distance, around, _ in states(fr, 50, seed=1):
        (law, goal), (fast, packed) = goals(pair, q, p, distance, around)
        same(fast.step(q, 1e-3, packed), law.step(q, 1e-3, goal))
        for ours, reference in zip(fast.task(q, packed), law.task(q, goal), strict=True):
            same(ours, reference)


def test_the_whole_integration(pair, fr, leader):
    scheme, reach = Scheme(), np.full(6, 0.2)
    ended = set()
    for q, p, distance, _, _ in states(fr, 40, seed=2):
        start = fr.start + 0.05 * (q - fr.start)
        (law, goal), (fast, packed) = goals(
            pair, start, 0.1 * p + (1.8, 0.0, 1.0), distance, leader.obstacles(p)
        )
        ours = fast.run(start, packed, reach, scheme, origin=start - 1e-3)
        reference = law.run(start, goal, reach, scheme, origin=start - 1e-3)
        assert (ours.steps, ours.ended) == (reference.steps, reference.ended)
        np.testing.assert_allclose(ours.q, reference.q, rtol=0.0, atol=1e-12)
        ended.add(ours.ended)
    assert len(ended) > 1


def test_induced_velocity(pair, fr):
    for q, p, distance, around, v in states(fr, 50, seed=3):
        (law, goal), (fast, packed) = goals(pair, q, p, distance, around)
        same(fast.induced(q, packed, v), law.induced(q, goal, v))


def test_remaining_shares_scale_the_weights(pair, fr):
    rng = np.random.default_rng(6)
    for q, p, distance, around, v in states(fr, 60, seed=6):
        ways = rng.uniform(0.1, 1.0, (2, 6))
        ways[:, rng.integers(0, 6)] = 0.0  # with most joints blocked the task is singular, and rounding grows
        for emergency in (False, True):
            (law, goal), (fast, packed) = goals(
                pair, q, p, distance, around, ways=ways, velocity=v, emergency=emergency
            )
            same(fast(q, packed), law(q, goal))
        same(fast.induced(q, packed, v), law.induced(q, goal, v))


def chases(robot, bounds, count, seed):
    """Yield motions, near limits and at speeds that need braking or blending, and what to chase."""
    rng = np.random.default_rng(seed)
    for q, p, distance, around, v in states(robot, count, seed=seed):
        start = robot.start + rng.choice([0.05, 0.9]) * (q - robot.start)
        if rng.uniform() < 0.3:  # almost in view, at rest
            at = robot.model.frame(start, "camera")
            target = at.t + distance * at.R[:, 2] + 1e-5 * v
            yield Motion(start, start, np.zeros(6)), (target, np.zeros(3), distance), around, (bounds, None)
            continue
        last = rng.choice([0.0, 0.3, 1.0]) * rng.uniform(-1.0, 1.0, 6) * bounds.step
        limits, ways = bounds, None
        if rng.uniform() < 0.3:
            near = bounds.tightened(start - rng.uniform(0.0, 0.05, 6), start + rng.uniform(0.0, 0.05, 6))
            limits, ways = near, rng.uniform(0.1, 1.0, (2, 6))
        motion = Motion(start + rng.choice([0.0, 1e-3]), start, last)
        yield motion, (p, rng.choice([0.0, 0.1]) * v, distance), around, (limits, ways)


@pytest.mark.daily(2)
@pytest.mark.parametrize("emergency", [False, True])
def test_chase_with_limits_acceleration_and_kept_view(pair, fr, bounds, emergency):
    kinds = set()
    for motion, target, around, room in chases(fr, bounds, 150, seed=7):
        reference, ours = (
            law.chase(bounds, 0.012, Scheme()).step(
                motion, Aim(*target, law.scene(around, motion.setpoint), emergency, *room)
            )
            for law in pair
        )
        assert (ours.steps, ours.ended, ours.bounded) == (reference.steps, reference.ended, reference.bounded)
        np.testing.assert_allclose(ours.dq, reference.dq, rtol=0.0, atol=1e-12)
        kinds.add((ours.ended, ours.bounded, room[0].admits(motion.last, motion.setpoint)))
    assert len(kinds) >= 3


def test_view_errors(pair, fr):
    law, fast = pair
    for q, p, distance, _, _ in states(fr, 50, seed=8):
        same(fast.errors(q, p, distance), law.errors(q, p, distance))


@pytest.mark.parametrize("frame", ["tool0", "base_link"])
@pytest.mark.parametrize("name", ["FR", "GR"])
def test_leader(cell, name, frame):
    model = cell.robot(name).model
    leader, fast = Leader(model, frame, -0.5), CompiledLeader(model, frame, -0.5)
    for one in (fast, pickle.loads(pickle.dumps(fast))):
        for q, *_ in states(cell.robot(name), 30, seed=9):
            (tool, around), (reference, expected) = one.at(q), leader.at(q)
            same(tool, reference)
            same(around.centres, expected.centres)
            np.testing.assert_array_equal(around.radii, expected.radii)
            assert around.floor == expected.floor == -0.5


def test_leader_at_an_unknown_position(fr):
    tool, around = CompiledLeader(fr.model, "tool0", 0.1).at(None)
    assert (tool, len(around.radii), around.floor) == (None, 0, 0.1)


def test_leader_with_an_unknown_tool(fr):
    for kind in (Leader, CompiledLeader):
        with pytest.raises(ModelError, match="no frame 'gripper'"):
            kind(fr.model, "gripper", None)


def test_a_scene_can_be_used_again_after_a_chase(pair, fr, bounds):
    _, fast = pair
    around = Obstacles(np.array([[1.0, 0.0, 1.0]]), np.array([0.2]), 0.0)
    scene, goal = fast.scene(around, fr.start), ([2.0, 0.1, 1.0], 1.0)
    before = fast(fr.start, fast.goal(*goal, scene))
    ways = np.zeros((2, 6))
    fast.chase(bounds, 0.012, Scheme()).step(
        Motion(fr.start, fr.start, np.zeros(6)),
        Aim(np.ones(3), np.ones(3), 0.7, scene, True, bounds, ways),
    )
    np.testing.assert_array_equal(fast(fr.start, fast.goal(*goal, scene)), before)


def test_gaps_with_and_without_obstacles(pair, fr):
    law, fast = pair
    touched = 0
    for q, _, _, around, _ in states(fr, 50, seed=4):
        ours, reference = fast.scene(around, q), law.scene(around, q)
        assert ours.gap == pytest.approx(reference.gap, abs=1e-12)
        assert ours.own_gap == pytest.approx(reference.own_gap, abs=1e-12)
        touched += reference.own_gap < law.gains.own_reach
    assert 5 < touched < 50
    assert fast.scene(Obstacles(), q).gap == np.inf


def test_a_robot_with_prismatic_joints(cell):
    robot = cell.robot("GR")
    law, fast = CameraLaw(robot.model, "tool0"), CompiledLaw(robot.model, "tool0")
    for q, p, distance, around, _ in states(robot, 60, seed=5):
        (_, goal), (_, packed) = goals((law, fast), q, p, distance, around)
        same(fast(q, packed), law(q, goal))


@pytest.mark.daily(34)
@pytest.mark.parametrize("where", ["behind", "in the lens", "beside the antipode"])
def test_special_positions_of_the_target(pair, fr, where, q):
    at = fr.model.frame(q, "camera")
    aside = 1e-5 * at.R[:, 0]
    p = {"behind": at.t - at.R[:, 2], "in the lens": at.t, "beside the antipode": at.t - at.R[:, 2] + aside}[
        where
    ]
    (law, goal), (fast, packed) = goals(pair, q, p, 1.0, Obstacles())
    ours, reference = fast(q, packed), law(q, goal)
    assert np.isfinite(ours).all()
    if where == "beside the antipode":  # elsewhere a rounding error decides the direction
        np.testing.assert_allclose(ours, reference, rtol=1e-5, atol=1e-5)


def test_any_array_like_is_accepted(pair, fr):
    _, fast = pair
    goal = fast.goal([2.0, 0.1, 1.0], 1.0)
    fixed = np.array(fr.start)
    fixed.setflags(write=False)
    strided = np.repeat(fr.start, 2)[::2]
    same(fast(fixed, goal), fast(strided, goal))


def test_scenes_and_goals_of_the_other_form_are_refused(pair, fr):
    law, fast = pair
    with pytest.raises(TypeError, match="made by this law"):
        fast(fr.start, law.goal([2.0, 0.0, 1.0], 1.0))
    with pytest.raises(TypeError, match="made by this law"):
        fast.goal([2.0, 0.0, 1.0], 1.0, law.scene(Obstacles(), fr.start))
    with pytest.raises(TypeError, match="made by this law"):
        law(fr.start, law.goal([2.0, 0.0, 1.0], 1.0, fast.scene(Obstacles(), fr.start)))


def test_the_compiled_form_is_used_with_numba(fr):
    assert available()
    assert type(camera_law(fr.model, "camera")) is CompiledLaw


def run(code, **environment):
    return subprocess.run(
        [sys.executable, "-c", code],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )


def test_without_numba_the_readable_form_is_used(fr, tmp_path):
    urdf = tmp_path / "robot.urdf"
    urdf.write_text(fr.urdf, encoding="utf-8")
    done = run(
        "import sys; sys.modules['numba'] = None\n"
        "from pathlib import Path\n"
        "from armgate.cell.model import RobotModel\n"
        "from armgate.cell.placement import Placement\n"
        "from armgate.control.compiled import camera_law, prepare\n"
        "prepare()\n"
        f"model = RobotModel.from_urdf(Path({str(urdf)!r}).read_text(), Placement.identity())\n"
        "print(type(camera_law(model, 'camera')).__name__)"
    )
    assert done.stdout == "CameraLaw\n", done.stderr


def test_kernels_work_if_no_cache_can_be_written(tmp_path):
    """numba refuses `cache=True` when it finds no place for it; a kernel then compiles for its process."""
    nowhere = tmp_path / "file"
    nowhere.write_text("", encoding="utf-8")
    module = tmp_path / "readonly.py"
    module.write_text("def double(x):\n    return 2 * x\n", encoding="utf-8")
    done = run(
        "import sys\n"
        f"sys.path.insert(0, {str(tmp_path)!r})\n"
        "from numba.core import caching\n"
        "caching.CacheImpl._locator_classes = []\n"
        "from armgate.cell.compilation import kernel\n"
        "import readonly\n"
        "print(kernel(readonly.double)(21))",
        HOME=str(nowhere),
    )
    assert done.stdout == "42\n", done.stderr
