"""Places are clear and reachable; tasks measure what they state."""

import numpy as np
import pytest

from armgate.control.view_errors import view_errors


def made(task, **options):
    import gymnasium

    return gymnasium.make(f"armgate.env:armgate/{task}-v0", **options).unwrapped


def test_places_are_clear_at_rest_and_differ():
    env = made("Reach", places=6)
    seen = []
    for place in range(6):
        info = env.reset(seed=0, options={"place": place})[1]
        arm = env.episode.arms["P"]
        assert np.abs(arm.increment).max() < 1e-6
        assert arm.q == pytest.approx(arm.setpoint, abs=1e-5)
        assert info["margin"] > 0.0
        seen.append(arm.q)
    assert seen[0] == pytest.approx(env.cell.robot("P").start, abs=1e-9)
    assert all(np.abs(a - b).max() > 0.05 for k, a in enumerate(seen) for b in seen[:k])


def test_random_starts_depend_on_the_seed_only():
    env = made("Reach", places=8)
    times = [env.reset(seed=seed)[1]["time"] for seed in (1, 2, 3, 4, 1)]
    assert times[0] == times[-1]
    assert len(set(times)) > 2


def test_reach_rewards_progress_and_ends_at_the_goal():
    env = made("Reach", random_start=False, tolerance=0.02)
    robot = env.cell.robot("P")
    wanted = robot.start + np.array([-0.3, 0.1, 0.0])
    goal = robot.model.frame(wanted, robot.tool).t
    observation, _ = env.reset(seed=0, options={"goal": goal})
    start = robot.model.frame(robot.start, robot.tool).t
    assert observation[-3:] == pytest.approx(goal - start, abs=1e-6)
    total, steps, ended = 0.0, 0, False
    while not ended:
        arm = env.episode.arms["P"]
        way = wanted - arm.setpoint
        action = np.clip(way / (robot.velocity * robot.period), -0.3, 0.3)
        _, reward, ended, _, info = env.step(action)
        total, steps = total + reward, steps + 1
        assert steps < 200
    left = info["measures"]["distance"]
    assert info["measures"]["success"] == 1.0
    assert left <= 0.02
    assert total == pytest.approx(10.0 * (np.linalg.norm(goal - start) - left) - 0.01 * steps + 10.0)


@pytest.mark.parametrize("goal", [[0.0, 1.0], "there", [0.0, 0.0, np.nan]])
def test_a_goal_that_is_no_point_is_one_error(goal):
    from armgate.env import EnvError

    with pytest.raises(EnvError, match="expected a point of three finite numbers"):
        made("Reach", random_start=False).reset(seed=0, options={"goal": goal})


@pytest.mark.parametrize("value", [0, -1.0, np.nan, np.inf, "a", None])
def test_a_tolerance_or_distance_that_is_not_positive_is_one_error(value):
    from armgate.env import EnvError, Follow, Reach

    with pytest.raises(EnvError, match=r"tolerance: .*; expected a finite positive number"):
        Reach(tolerance=value)
    with pytest.raises(EnvError, match=r"distance: .*; expected a finite positive number"):
        Follow(distance=value)


def test_follow_measures_the_errors_of_the_camera_while_the_leader_plays_its_path():
    env = made("Follow")
    env.reset(seed=0)
    before = env.episode.arms["GR"].setpoint
    random = np.random.default_rng(0)
    for _ in range(120):
        _, reward, _, _, info = env.step(random.uniform(-0.1, 0.1, 6))
        arms, cell = env.episode.arms, env.cell
        camera, leader = cell.robot("FR"), cell.robot("GR")
        tool = leader.model.frame(arms["GR"].q, leader.tool).t
        angle, error = view_errors(camera.model, camera.camera, arms["FR"].q, tool, 1.0)
        assert info["measures"] == pytest.approx({"angle_error": angle, "distance_error": error})
        assert reward == pytest.approx(1.0 - angle / (0.5 * np.pi) - abs(error))
    assert np.abs(env.episode.arms["GR"].setpoint - before).max() > 1e-3


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"robots": "GR", "leader": "FR"}, "'GR' is not a robot of the agent with a camera"),
        ({"leader": "FR"}, "FR: commanded by the agent and by a program"),
    ],
)
def test_a_task_that_does_not_fit_its_cell_is_one_error(options, text):
    from armgate.env import EnvError

    with pytest.raises(EnvError, match=text):
        made("Follow", **options)
