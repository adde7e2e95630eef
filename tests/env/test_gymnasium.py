"""The environments keep Gymnasium's promises, alone and as vectors."""

import pickle
from functools import partial

import numpy as np
import pytest

NAMES = ("Cell", "Reach", "Follow")


def make(name, **options):
    import gymnasium

    cell = {"cell": "configs/planar.yaml"} if name == "Cell" else {}
    return gymnasium.make(f"armgate.env:armgate/{name}-v0", **cell, **options)


def run(env, steps, seed):
    """Return everything that an environment returns for random actions, as bytes."""
    env.action_space.seed(seed)
    returned = [env.reset(seed=seed)]
    for _ in range(steps):
        returned.append(env.step(env.action_space.sample()))
        if returned[-1][2] or returned[-1][3]:
            returned.append(env.reset())
    return pickle.dumps(returned)


@pytest.mark.parametrize("observation", ["flat", "dict"])
@pytest.mark.parametrize("name", NAMES)
def test_gymnasiums_checker_finds_nothing(name, observation):
    from gymnasium.utils.env_checker import check_env

    env = make(name, observation=observation, places=2)
    check_env(env.unwrapped)


@pytest.mark.parametrize("name", NAMES)
def test_equal_seeds_and_actions_give_equal_bytes(name):
    first, second = (run(make(name, places=4, max_episode_steps=20), 60, seed=3) for _ in range(2))
    assert first == second
    if name == "Reach":
        assert run(make(name, places=4, max_episode_steps=20), 60, seed=4) != first


def test_an_episode_is_truncated_by_its_time_limit():
    env = make("Reach", places=2, max_episode_steps=3)
    env.reset(seed=0)
    still = np.zeros(3, np.float32)
    assert [env.step(still)[3] for _ in range(3)] == [False, False, True]


def test_importing_the_package_again_registers_nothing_twice():
    import gymnasium

    from armgate.env.registration import register_all

    before = dict(gymnasium.registry)
    register_all(gymnasium)
    assert gymnasium.registry == before


def vector_run(envs, steps=45):
    envs.action_space.seed(1)
    begin = envs.reset(seed=5)
    returned = [envs.step(envs.action_space.sample()) for _ in range(steps)]
    envs.close()
    return [begin, *returned]


@pytest.mark.daily(1)
@pytest.mark.parametrize("observation", ["dict", "flat"])
def test_vectors_of_workers_return_the_same_as_one_process(observation):
    from gymnasium.utils.env_checker import data_equivalence
    from gymnasium.vector import SyncVectorEnv

    from armgate.env import WorkerVectorEnv

    one = partial(make, "Reach", places=2, max_episode_steps=20, observation=observation)
    wanted = vector_run(SyncVectorEnv([one] * 3))
    assert wanted[-1][4]["robots"]["P"]["q"].shape == (3, 3)
    assert data_equivalence(vector_run(WorkerVectorEnv([one] * 3, workers=2)), wanted, exact=True)


@pytest.mark.slow
@pytest.mark.parametrize("context", ["forkserver", "fork"])
def test_gymnasiums_asynchronous_vectors_return_the_same_as_one_process(context):
    from gymnasium.utils.env_checker import data_equivalence
    from gymnasium.vector import AsyncVectorEnv, SyncVectorEnv

    one = partial(make, "Reach", places=2, max_episode_steps=20)
    wanted = vector_run(SyncVectorEnv([one] * 2))
    assert data_equivalence(vector_run(AsyncVectorEnv([one] * 2, context=context)), wanted, exact=True)


@pytest.mark.slow
def test_a_vector_without_autoreset_resets_the_environments_of_the_mask():
    from gymnasium.vector import SyncVectorEnv

    from armgate.env import WorkerVectorEnv

    def returned(envs):
        envs.reset(seed=1)
        envs.step(np.ones((3, 3), np.float32))
        observations, infos = envs.reset(options={"reset_mask": np.array([False, False, True])})
        envs.close()
        return observations, infos["time"]

    one = partial(make, "Reach", places=2)
    wanted = returned(SyncVectorEnv([one] * 3, autoreset_mode="Disabled"))
    found = returned(WorkerVectorEnv([one] * 3, workers=2, autoreset_mode="Disabled"))
    assert all(np.array_equal(a, b) for a, b in zip(found, wanted, strict=True))


def test_errors_in_a_worker_are_raised_and_the_vector_continues():
    import gymnasium

    from armgate.env import ActionError, EnvError, WorkerVectorEnv

    envs = WorkerVectorEnv([partial(make, "Reach", places=2)] * 2, workers=2)
    envs.reset(seed=0)
    for actions in (np.full((2, 3), np.nan), np.zeros((1, 3)), 0.0, [[0.0] * 3, [0.0]]):
        with pytest.raises(ActionError, match="expected 2 rows of finite numbers"):
            envs.step(actions)
    with pytest.raises(ActionError, match=r"action of shape \(2,\); expected \(3,\)"):
        envs.step(np.zeros((2, 2)))
    with pytest.raises(EnvError, match="1 seeds for 2 environments"):
        envs.reset(seed=[1])
    assert envs.step(np.zeros((2, 3)))[0].shape == (2, 13)
    envs.close()
    envs.close()
    with pytest.raises(gymnasium.error.ClosedEnvironmentError):
        envs.reset()


@pytest.mark.slow
def test_environments_with_different_spaces_are_one_error():
    from armgate.env import EnvError, WorkerVectorEnv

    with pytest.raises(EnvError, match="the environments have different spaces"):
        WorkerVectorEnv([partial(make, "Reach"), partial(make, "Reach", observation="dict")], workers=2)


@pytest.mark.slow
def test_a_worker_that_is_killed_is_one_error():
    from armgate.env import EnvError, WorkerVectorEnv

    envs = WorkerVectorEnv([partial(make, "Reach", places=2)] * 2, workers=2)
    envs.reset(seed=0)
    envs._workers[1]._process.kill()
    for _ in range(2):
        with pytest.raises(EnvError, match="a worker has ended with exit code -9"):
            envs.step(np.zeros((2, 3)))
    envs.close()


class UnsendableError(Exception):
    """Error that cannot be made again from its arguments."""

    def __init__(self, first, second):
        super().__init__(f"{first} and {second}")


def fail():
    raise UnsendableError("a", "b")


def test_errors_of_workers_at_their_start_end_all_workers():
    from armgate.env import EnvError, WorkerVectorEnv

    with pytest.raises(EnvError, match="UnsendableError: a and b"):
        WorkerVectorEnv([partial(make, "Reach", places=2), fail], workers=2)
    with pytest.raises(EnvError, match="workers: 3; expected 1 to 2"):
        WorkerVectorEnv([partial(make, "Reach")] * 2, workers=3)
    with pytest.raises(EnvError, match="no robot X"):
        WorkerVectorEnv([partial(make, "Reach", robots="X")] * 2)
