"""Tasks: goals and rewards of an agent."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from armgate.cell.cell import Cell
from armgate.env.errors import EnvError
from armgate.env.transition import ArmState

Array = NDArray[np.float64]
Arms = Mapping[str, ArmState]


@dataclass(frozen=True)
class Scene:
    """The cell of an environment, for tasks.

    Attributes:
        cell: The cell.
        robots: Names of the robots that the agent commands.
        others: Names of the other robots.
        clear_position: Draws a position of the agent's robots that is clear and reachable from the start:
            (n,) by robot, rad or m.
    """

    cell: Cell
    robots: tuple[str, ...]
    others: tuple[str, ...]
    clear_position: Callable[[np.random.Generator], Mapping[str, Array]]


@dataclass(frozen=True)
class Assessment:
    """Result of a task for one step.

    Attributes:
        reward: The reward.
        terminated: True if the task has ended, for example because its goal is reached.
        measures: Numbers for ``info["measures"]`` and for reward functions.
    """

    reward: float
    terminated: bool = False
    measures: Mapping[str, float] = field(default_factory=dict)


class Task(Protocol):
    """Task of an agent: `bind` is called once, `begin` for each episode, `assess` for each step."""

    def bind(self, scene: Scene) -> Mapping[str, int]:
        """Prepare for a cell; return the names and sizes of the parts that `observe` returns.

        Raises:
            EnvError: The task does not fit the cell.
        """

    def begin(self, arms: Arms, random: np.random.Generator, options: Mapping[str, Any]) -> None:
        """Begin an episode.

        Args:
            arms: States of all robots.
            random: Source of all random choices.
            options: Options of ``reset`` that the environment does not know.

        Raises:
            EnvError: An option is unknown or has a wrong value.
        """

    def assess(self, arms: Arms) -> Assessment:
        """Return the reward of a step that led to these states."""

    def observe(self) -> Mapping[str, Array]:
        """Return the task's parts of the observation, scaled to about −1…1.

        It is called after `begin`, `assess` or `restore`, and refers to the same states.
        """

    def state(self) -> Any:
        """Return the state of the episode, picklable."""

    def restore(self, state: Any) -> None:
        """Continue an episode with a state that `state` returned."""


class Free:
    """Task without a goal: the reward is 0, and an episode ends only by its time limit."""

    def bind(self, scene: Scene) -> Mapping[str, int]:
        """Add no observation."""
        return {}

    def begin(self, arms: Arms, random: np.random.Generator, options: Mapping[str, Any]) -> None:
        """Refuse options."""
        refuse_options(options, ())

    def assess(self, arms: Arms) -> Assessment:
        """Return no reward."""
        return Assessment(0.0)

    def observe(self) -> Mapping[str, Array]:
        """Return nothing."""
        return {}

    def state(self) -> None:
        """Return nothing."""

    def restore(self, state: None) -> None:
        """Restore nothing."""


def positive(name: str, value: float) -> float:
    """Return an argument of a task that must be positive.

    Raises:
        EnvError: It is not a finite positive number.
    """
    if isinstance(value, int | float) and 0.0 < value < math.inf:
        return value
    raise EnvError(f"{name}: {value!r}; expected a finite positive number")


def refuse_options(options: Mapping[str, Any], known: tuple[str, ...]) -> None:
    """Check that options of ``reset`` are known to the task.

    Raises:
        EnvError: An option is unknown.
    """
    strange = sorted(set(options) - set(known))
    if strange:
        expected = ", ".join(("place", "state", *known))
        raise EnvError(f"reset has no option {', '.join(map(repr, strange))}; expected {expected}")
