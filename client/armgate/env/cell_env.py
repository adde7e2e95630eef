"""Gymnasium environment of a cell: the agent's increments pass the gate, as those of any controller."""

import pickle
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import gymnasium
import numpy as np

from armgate.cell.cell import Cell, build_cell
from armgate.cell.config import load_config
from armgate.env.actions import Actions, Units
from armgate.env.episode import Cast, Episode, MakeProgram
from armgate.env.errors import EnvError
from armgate.env.info import info_of
from armgate.env.observations import Form, Observations
from armgate.env.places import Places
from armgate.env.recordings import Recordings
from armgate.env.tasks import Assessment, Free, Scene, Task
from armgate.env.transition import Transition
from armgate.protocol.messages import Verdict

CellFiles = str | Path | Sequence[str | Path] | Cell
"""Cell of an environment: a configuration file, several (later ones are overlays), or a built cell."""


class CellEnv(gymnasium.Env):  # type: ignore[misc]
    """Environment of any cell with emulated robots.

    A step sends one increment for each tick of the agent's slowest robot. It never fails because of the gate:
    limited and refused increments are in ``info``, see `armgate.env.info`.

    Args:
        cell: The cell.
        robots: Robots that the agent commands; None: all that have no program.
        programs: Functions that make the programs of other robots, by robot. Robots without one rest.
        task: The task; None: `Free`.
        reward: Function that returns the reward of a step instead of the task, see `Transition`.
        units: Units of actions.
        within: True to adjust increments to the bounds that do not depend on other bodies, see `Actions`.
        observation: Form of observations, see `Observations`.
        repeat: Ticks per step, for which the action is repeated.
        random_start: True to begin each episode at a random place.
        places: Number of places; place 0 is the configured start.
        spread: Largest distance of places from the start, as a share of each joint's range.
        record: Folder in which each episode is recorded, in a folder of its own; None: no recording.
        compiled: Form of the gate's kernels, as for `World`.
        render_mode: Only None: a recording can be watched instead.

    Attributes:
        cell: The cell.

    Raises:
        EnvError: An argument does not fit the cell.
        ConfigError: The configuration is not valid, or a robot has a clock of its own.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": []}

    def __init__(
        self,
        cell: CellFiles,
        robots: Sequence[str] | str | None = None,
        *,
        programs: Mapping[str, MakeProgram] | None = None,
        task: Task | None = None,
        reward: Callable[[Transition], float] | None = None,
        units: Units = "share",
        within: bool = True,
        observation: Form = "flat",
        repeat: int = 1,
        random_start: bool = False,
        places: int = 32,
        spread: float = 0.3,
        record: str | Path | None = None,
        compiled: bool | None = None,
        render_mode: None = None,
    ) -> None:
        if render_mode is not None:
            raise EnvError(f"render_mode {render_mode!r}; expected None: record an episode and view it")
        _check_count("repeat", repeat, 10_000)
        _check_count("places", places, 100_000)
        if not 0.0 <= spread <= 1.0:
            raise EnvError(f"spread: {spread!r}; expected 0 to 1")
        self.render_mode = None
        self.cell = cell if isinstance(cell, Cell) else _built(cell)
        self._programs = dict(programs or {})
        self._cast = _cast(self.cell, robots, self._programs)
        self._task = Free() if task is None else task
        self._reward = reward
        self._repeat = repeat
        self._random_start = random_start
        self._places = Places(self._cast, places, spread, compiled)
        self._recordings = None if record is None else Recordings(Path(record))
        self._make_spaces(units, within, observation)
        self._places.position(0)  # kernels are compiled now, and a cell that cannot run is an error now
        self._episode: Episode | None = None

    def _make_spaces(self, units: Units, within: bool, observation: Form) -> None:
        own = [self.cell.robot(name) for name in self._cast.agent]
        others = [robot for robot in self.cell.robots if robot.name not in self._cast.agent]
        scene = Scene(
            self.cell, self._cast.agent, tuple(robot.name for robot in others), self._clear_position
        )
        self._actions = Actions(own, units, within)
        self._observations = Observations(own, others, self._task.bind(scene), observation)
        self.action_space = self._actions.space
        self.observation_space = self._observations.space

    def _clear_position(self, random: np.random.Generator) -> Mapping[str, Any]:
        return self._places.position(int(random.integers(self._places.count)))

    @property
    def episode(self) -> Episode:
        """The current episode.

        Raises:
            ResetNeeded: There was no reset.
        """
        if self._episode is None:
            raise gymnasium.error.ResetNeeded("no episode has begun; call reset() first")
        return self._episode

    # --- gymnasium ----------------------------------------------------------------------------------------

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin a new episode.

        Args:
            seed: Seed of all random choices from now on.
            options: ``place``: number of the place to begin at; ``state``: bytes from `save`, to continue
                there; others as the task knows them.

        Raises:
            EnvError: An option is unknown or has a wrong value.
        """
        given = _mapping(options)
        super().reset(seed=seed)
        state, place = given.pop("state", None), given.pop("place", None)
        self._close_recording()
        if state is not None:
            self._restore(state, given, place)
        else:
            self._begin(self._place(place), given)
        now = self._transition(np.zeros_like(self.action_space.low), (), Assessment(0.0))
        return self._observations.of(now.arms, self._task.observe()), info_of(now, self._cast.agent)

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Command one increment for each tick of the step.

        Raises:
            ActionError: The action is not an array of finite numbers of the right shape.
        """
        given = self._actions.checked(action)
        wanted = self._actions.wanted(given)
        verdicts = [v for _ in range(self._repeat) for v in self.episode.step(self._actions, wanted)]
        transition = self._transition(given, tuple(verdicts), None)
        reward = transition.reward if self._reward is None else float(self._reward(transition))
        stopped = any(transition.arms[robot].stopped for robot in self._cast.agent)
        observation = self._observations.of(transition.arms, self._task.observe())
        info = info_of(transition, self._cast.agent)
        return observation, reward, transition.terminated or stopped, False, info

    def close(self) -> None:
        """End the episode, and close its recording."""
        self._close_recording()
        self._episode = None

    def __getstate__(self) -> dict[str, Any]:
        """Return the state of a copy; raise `EnvError` if the environment records."""
        if self._recordings is not None:
            raise EnvError("an environment that records cannot be copied; make another one")
        return dict(self.__dict__)

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Continue in a copy."""
        self.__dict__.update(state)
        if self._episode is not None:
            self._episode.resume(self.cell)

    # --- episodes -----------------------------------------------------------------------------------------

    def save(self) -> bytes:
        """Return the state of the episode, for the option ``state`` of `reset` in an equal environment.

        The programs of other robots are saved too, so they must be picklable.
        """
        kind = type(self._task).__qualname__
        return pickle.dumps((self._cast.agent, self._cast.driven, kind, self.episode, self._task.state()))

    def _begin(self, place: int, options: Mapping[str, Any]) -> None:
        if self._recordings is None:
            self._episode = self._places.episode(place)
        else:
            self._episode = self._places.recorded(place, [self._recordings.begin()])
        self.episode.add_programs(self._programs)
        self._task.begin(self.episode.arms, self.np_random, options)

    def _restore(self, state: object, options: Mapping[str, Any], place: object) -> None:
        if options or place is not None:
            raise EnvError("reset: expected no other option beside 'state'")
        if self._recordings is not None:
            raise EnvError("reset: an episode that begins at a saved state cannot be recorded")
        self._episode, task = _unpickled(state, self._cast, type(self._task).__qualname__)
        self._task.restore(task)

    def _place(self, place: object) -> int:
        if place is None:
            return int(self.np_random.integers(self._places.count)) if self._random_start else 0
        return self._places.checked(place)

    def _transition(self, action: Any, verdicts: tuple[Verdict, ...], found: Assessment | None) -> Transition:
        """Return the step that led to the present states; the task assesses it unless ``found`` is given."""
        episode = self.episode
        arms = episode.arms
        result = self._task.assess(arms) if found is None else found
        return Transition(
            episode.world.time, arms, action, verdicts, episode.outcomes,
            result.measures, result.reward, result.terminated,
        )  # fmt: skip

    def _close_recording(self) -> None:
        if self._recordings is not None:
            self._recordings.close()


def _mapping(options: object) -> dict[str, Any]:
    if options is not None and not isinstance(options, Mapping):
        raise EnvError(f"reset options: {options!r}; expected a mapping")
    return dict(options or {})


def _unpickled(state: object, cast: Cast, kind: str) -> tuple[Episode, Any]:
    """Return a saved episode, resumed, and the state of its task."""
    if not isinstance(state, bytes):
        raise EnvError(f"reset option 'state': a {type(state).__name__}; expected bytes from save()")
    try:
        agent, driven, saved, episode, task = pickle.loads(state)  # noqa: S301 (of trusted programs)
        if not isinstance(episode, Episode):
            raise TypeError(f"a {type(episode).__name__}")
    except Exception as error:
        raise EnvError(f"reset option 'state': not a saved episode: {error}") from error
    if (agent, driven) != (cast.agent, cast.driven):
        text = f"the agent commanded {', '.join(agent)} in another environment"
        raise EnvError(f"reset option 'state': {text}")
    if saved != kind:
        raise EnvError(f"reset option 'state': saved with the task {saved}; this environment has {kind}")
    episode.resume(cast.cell)
    return episode, task


def _built(files: str | Path | Sequence[str | Path]) -> Cell:
    given = [files] if isinstance(files, str | Path) else files
    return build_cell(load_config([Path(file) for file in given]))


def _cast(cell: Cell, robots: Sequence[str] | str | None, programs: Mapping[str, object]) -> Cast:
    names = [robot.name for robot in cell.robots]
    if robots is None:
        own = [name for name in names if name not in programs]
    else:
        own = [robots] if isinstance(robots, str) else list(robots)
    strange = [name for name in (*own, *programs) if name not in names]
    if strange:
        raise EnvError(f"no robot {', '.join(strange)} in cell {cell.name}; it has {', '.join(names)}")
    if not own or len(set(own)) < len(own):
        raise EnvError("robots: expected at least one robot without a program, each once")
    if both := [name for name in own if name in programs]:
        raise EnvError(f"{', '.join(both)}: commanded by the agent and by a program; expected one of them")
    return Cast(cell, tuple(own), tuple(programs))


def _check_count(name: str, value: int, most: int) -> None:
    if isinstance(value, bool) or not isinstance(value, int) or not 1 <= value <= most:
        raise EnvError(f"{name}: {value!r}; expected 1 to {most}")
