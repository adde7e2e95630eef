"""Vector environment with several environments per worker process.

Gymnasium's ``AsyncVectorEnv`` exchanges messages with one process per environment in each step, which takes
about as long as a step of a world. Here each worker steps its share of the environments between two messages.
"""

import contextlib
import multiprocessing
import pickle
from collections.abc import Callable, Mapping, Sequence
from multiprocessing.connection import Connection
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, SyncVectorEnv, VectorEnv
from gymnasium.vector.utils import CloudpickleWrapper, batch_space

from armgate.env.actions import finite_array
from armgate.env.errors import ActionError, EnvError

MakeEnv = Callable[[], gymnasium.Env]


class WorkerVectorEnv(VectorEnv):  # type: ignore[misc]
    """Vector environment whose workers run a ``SyncVectorEnv`` each.

    It returns what one ``SyncVectorEnv`` of all environments would return.

    Args:
        env_fns: Functions that make the environments; all have the same spaces.
        workers: Number of worker processes, at most one per environment.
        autoreset_mode: Mode in which an environment begins its next episode, as for ``SyncVectorEnv``.

    Raises:
        EnvError: There is no environment, or the number of workers does not fit.
    """

    def __init__(
        self,
        env_fns: Sequence[MakeEnv],
        workers: int = 2,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
    ) -> None:
        if not 1 <= workers <= len(env_fns):
            raise EnvError(f"workers: {workers}; expected 1 to {len(env_fns)}, the number of environments")
        mode = AutoresetMode(autoreset_mode)
        self.num_envs = len(env_fns)
        self._ends = [len(env_fns) * (k + 1) // workers for k in range(workers)]
        shares = [env_fns[begin:end] for begin, end in zip([0, *self._ends], self._ends, strict=False)]
        self._workers = [_Worker(share, mode) for share in shares]
        self._sizes = [len(share) for share in shares]
        observation, action, metadata = self._common_answer()
        self.single_observation_space, self.single_action_space = observation, action
        self.observation_space = batch_space(observation, self.num_envs)
        self.action_space = batch_space(action, self.num_envs)
        self.metadata = {**metadata, "autoreset_mode": mode}
        self.render_mode = None

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Reset all environments, or those of the option ``reset_mask``.

        Args:
            seed: Seed of the first environment, each later one has the next number; or a seed for each.
            options: Options for all environments.
        """
        self._check_open()
        if seed is None or isinstance(seed, int):
            seeds = [None if seed is None else seed + k for k in range(self.num_envs)]
        else:
            seeds = list(seed)
        if len(seeds) != self.num_envs:
            raise EnvError(f"{len(seeds)} seeds for {self.num_envs} environments; expected one for each")
        for worker, part in zip(self._workers, self._parts(), strict=True):
            worker.send("reset", (seeds[part], _part_of(options, part)))
        observations, infos = zip(*self._answers(), strict=True)
        return _joined(observations), _merged(infos, self._sizes)

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Step all environments; errors of actions are raised after all workers have answered."""
        self._check_open()
        checked = finite_array(actions)
        if checked is None or checked.shape[:1] != (self.num_envs,):
            raise ActionError(f"actions {actions!r}; expected {self.num_envs} rows of finite numbers")
        given = np.asarray(actions)
        for worker, part in zip(self._workers, self._parts(), strict=True):
            worker.send("step", given[part])
        observations, rewards, terminated, truncated, infos = zip(*self._answers(), strict=True)
        return (
            _joined(observations),
            np.concatenate(rewards),
            np.concatenate(terminated),
            np.concatenate(truncated),
            _merged(infos, self._sizes),
        )

    def close_extras(self, **_: Any) -> None:
        """End the workers."""
        for worker in self._workers:
            worker.close()

    def _parts(self) -> list[slice]:
        return [slice(begin, end) for begin, end in zip([0, *self._ends], self._ends, strict=False)]

    def _common_answer(self) -> Any:
        """Return the equal descriptions that all workers send; end all workers after an error."""
        try:
            first, *others = self._answers()
            if any(other[:2] != first[:2] for other in others):
                raise EnvError("the environments have different spaces; expected the same spaces")
        except Exception:
            self.close_extras()
            raise
        return first

    def _check_open(self) -> None:
        if self.closed:
            raise gymnasium.error.ClosedEnvironmentError("the environments are closed; make new ones")

    def _answers(self) -> list[Any]:
        """Return the answers of all workers; raise the first error among them."""
        answers = [worker.answer() for worker in self._workers]
        for answer in answers:
            if isinstance(answer, BaseException):
                raise answer
        return answers


class _Worker:
    """Process with a share of the environments."""

    def __init__(self, env_fns: Sequence[MakeEnv], mode: AutoresetMode) -> None:
        # A forked process would inherit locks of threads, such as those of the kernels' compiler.
        context = multiprocessing.get_context("forkserver")
        context.set_forkserver_preload(["armgate.env"])
        self._connection, other = context.Pipe()
        wrapped = CloudpickleWrapper(list(env_fns))
        self._process = context.Process(target=_work, args=(other, wrapped, mode.value), daemon=True)
        self._process.start()
        other.close()

    def send(self, command: str, argument: object) -> None:
        """Send a command; `answer` returns its result."""
        with contextlib.suppress(BrokenPipeError):  # the process has ended: `answer` reports it
            self._connection.send((command, argument))

    def answer(self) -> Any:
        """Return the next answer, or the exception that took its place."""
        try:
            return self._connection.recv()
        except (EOFError, ConnectionResetError):
            self._process.join()
            return EnvError(f"a worker has ended with exit code {self._process.exitcode}")

    def close(self) -> None:
        """End the process."""
        self._connection.close()
        self._process.join(5.0)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()


def _work(connection: Connection, env_fns: Any, mode: str) -> None:
    """Serve a worker until its connection is closed; errors are raised in the other process."""
    try:
        env = SyncVectorEnv(env_fns.fn, autoreset_mode=mode)
        connection.send((env.single_observation_space, env.single_action_space, dict(env.envs[0].metadata)))
    except Exception as error:
        connection.send(_sendable(error))
        return
    observations: Any = None
    with contextlib.suppress(EOFError, KeyboardInterrupt), contextlib.closing(env):
        while True:
            command, argument = connection.recv()
            try:
                answer = _reset(env, observations, *argument) if command == "reset" else env.step(argument)
                observations = answer[0]
            except Exception as error:
                answer = _sendable(error)
            connection.send(answer)


def _reset(env: Any, observations: Any, seeds: list[int | None], options: dict[str, Any] | None) -> Any:
    """Reset environments; if the mask has none of this worker, return their last observations."""
    if options is not None and "reset_mask" in options and not np.any(options["reset_mask"]):
        return observations, {}
    return env.reset(seed=seeds, options=options)


def _sendable(error: Exception) -> Exception:
    """Return an error that can be pickled: some exceptions cannot be made again from their arguments."""
    try:
        pickle.loads(pickle.dumps(error))  # noqa: S301 (its own bytes)
    except Exception:
        return EnvError(f"{type(error).__name__}: {error}")
    return error


def _part_of(options: Mapping[str, Any] | None, part: slice) -> dict[str, Any] | None:
    """Return the options for a part of the environments."""
    if options is None:
        return None
    given = dict(options)
    if "reset_mask" in given:
        given["reset_mask"] = given["reset_mask"][part]
    return given


def _joined(observations: Sequence[Any]) -> Any:
    if isinstance(observations[0], dict):
        return {key: np.concatenate([one[key] for one in observations]) for key in observations[0]}
    return np.concatenate(observations)


def _merged(infos: Sequence[Mapping[str, Any]], sizes: Sequence[int]) -> dict[str, Any]:
    """Return the infos of all workers as one; entries that a worker lacks are 0, False or None."""
    merged: dict[str, Any] = {}
    for key in dict.fromkeys(key for info in infos for key in info):
        found = [info.get(key) for info in infos]
        known = next(value for value in found if value is not None)
        if isinstance(known, dict):
            merged[key] = _merged([value or {} for value in found], sizes)
        else:
            merged[key] = np.concatenate(
                [
                    _empty(size, known) if value is None else value
                    for size, value in zip(sizes, found, strict=True)
                ]
            )
    return merged


def _empty(size: int, like: Any) -> Any:
    fill = None if like.dtype == object else 0
    return np.full((size, *like.shape[1:]), fill, like.dtype)
