"""Time of a step of the environments in the demo cell, and the speed of several workers.

The unit is one step of the same world with the same increments, without the environment: messages of the
agent, decisions of the gate, ticks and states.

    bench_env.py [STEPS]
"""

import sys
from collections.abc import Callable
from functools import partial
from time import perf_counter, perf_counter_ns, process_time

import gymnasium
import numpy as np
from gymnasium.vector import AsyncVectorEnv, VectorEnv
from report import Row, report
from scenes import CONFIGS

from armgate.env import CellEnv, WorkerVectorEnv

STEPS = int(sys.argv[1]) if len(sys.argv) > 1 else 3000
WARM_UP = 300
FEW, MANY = 8, 32
"""Environments of a vector: messages between the processes take the same time for both."""


def cell_env(**options: object) -> CellEnv:
    return gymnasium.make(
        "armgate.env:armgate/Cell-v0", cell=CONFIGS / "demo.yaml", robots="FR", **options
    ).unwrapped


def follow_env() -> CellEnv:
    return gymnasium.make("armgate.env:armgate/Follow-v0").unwrapped


def actions(env: gymnasium.Env, steps: int) -> np.ndarray:
    """Return slow motions of one joint after the other, which end where they began."""
    wave = 0.1 * np.sin(2.0 * np.pi * np.arange(steps) / 200.0)
    chosen = (np.arange(steps) // 200) % env.action_space.shape[-1]
    found = np.zeros((steps, env.action_space.shape[-1]), np.float32)
    found[np.arange(steps), chosen] = wave
    return found


def time_of(step: Callable[[np.ndarray], object], given: np.ndarray) -> tuple[float, float]:
    """Return median and mean of processor time of a step, ms."""
    for action in given[:WARM_UP]:
        step(action)
    times, begin = np.zeros(len(given)), process_time()
    for k, action in enumerate(given):
        start = perf_counter_ns()
        step(action)
        times[k] = 1e-6 * (perf_counter_ns() - start)
    return float(np.median(times)), 1e3 * (process_time() - begin) / len(given)


def single() -> list[Row]:
    """Return the time of a step of one environment."""
    env = cell_env()
    env.reset(seed=0)
    given = actions(env, STEPS)
    unit, unit_mean = time_of(lambda a: env.episode.step(env._actions, env._actions.wanted(a)), given)
    env.reset(seed=0)
    median, mean = time_of(env.step, given)
    follow = follow_env()
    follow.reset(seed=0)
    follow_median, follow_mean = time_of(follow.step, given)
    return [
        Row("a step of the world with the agent's command, median", unit, "ms"),
        Row("the same, mean of processor time", unit_mean, "ms"),
        Row("env.step of Cell-v0, median", median, "ms", 0.5),
        Row("the same, mean of processor time", mean, "ms"),
        Row("env.step of Follow-v0 with its leader, median", follow_median, "ms", 0.5),
        Row("the same, mean of processor time", follow_mean, "ms"),
        Row("env.step of Cell-v0", median / unit, "x a step of the world"),
    ]


def resets() -> list[Row]:
    """Return the time of a reset to a place that was made before."""
    env = cell_env(places=4, random_start=True)
    for place in range(4):
        env.reset(options={"place": place})
    begin = perf_counter()
    for seed in range(40):
        env.reset(seed=seed)
    return [Row("env.reset, mean", 1e3 * (perf_counter() - begin) / 40, "ms")]


def rate(envs: VectorEnv) -> float:
    """Return the steps per second of a vector, over all its environments."""
    envs.reset(seed=0)
    given = actions(envs, STEPS // envs.num_envs)
    count, begin = 0, 0.0
    for k, action in enumerate(given):
        if k == len(given) // 5:
            count, begin = 0, perf_counter()
        envs.step(np.tile(action, (envs.num_envs, 1)))
        count += envs.num_envs
    took = perf_counter() - begin
    envs.close()
    return count / took


def vectors() -> list[Row]:
    """Return the gain of a second worker."""
    one, four = cell_env, partial(cell_env, repeat=4)
    few = [rate(WorkerVectorEnv([one] * FEW, workers=count)) for count in (1, 2)]
    many = [rate(WorkerVectorEnv([one] * MANY, workers=count)) for count in (1, 2)]
    processes = [rate(AsyncVectorEnv([four] * count, context="forkserver")) for count in (1, 2)]
    return [
        Row(f"WorkerVectorEnv, {FEW} environments, 1 worker", few[0], "steps/s"),
        Row(f"{FEW} environments: 2 workers against 1", few[1] / few[0], "x"),
        Row(f"WorkerVectorEnv, {MANY} environments, 1 worker", many[0], "steps/s"),
        Row(f"{MANY} environments: 2 workers against 1", many[1] / many[0], "x", 1.8, at_least=True),
        Row("AsyncVectorEnv, repeat=4, 1 process", processes[0], "steps/s"),
        Row("2 processes against 1", processes[1] / processes[0], "x"),
    ]


if __name__ == "__main__":
    report("env", [*single(), *resets(), *vectors()])
