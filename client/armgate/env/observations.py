"""Observations: states and measures of the task as numbers from −1 to 1."""

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np
from gymnasium.spaces import Box, Dict
from numpy.typing import NDArray

from armgate.cell.cell import Robot
from armgate.env.errors import EnvError
from armgate.env.transition import ArmState

Array = NDArray[np.float64]
Form = Literal["flat", "dict"]

MARGIN = 0.25
"""Margin that is observed as 1, m."""


class Observations:
    """Conversion of states.

    Every number is scaled and then clipped to −1…1. The parts, in this order:

    ==============  ==========================================================================================
    ``q``           measured position of each joint of the agent's robots: −1 lower limit, 1 upper limit
    ``setpoint``    commanded position, in the same scale
    ``increment``   last increment, as a share of the largest one
    ``margin``      for each robot of the agent: nearest distance less the distance to be kept, 1: 0.25 m
    ``others``      measured positions of the other robots, if there are any
    task            parts of the task
    ==============  ==========================================================================================

    Args:
        own: Robots of the agent.
        others: Other robots.
        task: Sizes of the task's parts.
        form: ``flat``: one array; ``dict``: an array for each part.

    Attributes:
        space: Space of the observations.

    Raises:
        EnvError: The form is unknown.
    """

    def __init__(
        self, own: Sequence[Robot], others: Sequence[Robot], task: Mapping[str, int], form: Form
    ) -> None:
        if form not in ("flat", "dict"):
            raise EnvError(f"observation {form!r}; expected 'flat' or 'dict'")
        self._flat = form == "flat"
        self._own, self._others = [robot.name for robot in own], [robot.name for robot in others]
        self._middle, self._half = _ranges(own)
        self._others_middle, self._others_half = _ranges(others)
        self._largest = np.concatenate([robot.velocity * robot.period for robot in own])
        n = len(self._middle)
        sizes = {"q": n, "setpoint": n, "increment": n, "margin": len(own)}
        if others:
            sizes["others"] = len(self._others_middle)
        self._sizes = {**sizes, **task}
        boxes = {name: _box(size) for name, size in self._sizes.items()}
        self.space = _box(sum(self._sizes.values())) if self._flat else Dict(boxes)

    def of(self, arms: Mapping[str, ArmState], task: Mapping[str, Array]) -> Any:
        """Return the observation of these states, as a new array or dictionary of arrays."""
        own = [arms[robot] for robot in self._own]
        parts = {
            "q": (_joined(arm.q for arm in own) - self._middle) / self._half,
            "setpoint": (_joined(arm.setpoint for arm in own) - self._middle) / self._half,
            "increment": _joined(arm.increment for arm in own) / self._largest,
            "margin": np.array([min(arm.margin, 1.0) / MARGIN for arm in own]),
        }
        if self._others:
            q = _joined(arms[robot].q for robot in self._others)
            parts["others"] = (q - self._others_middle) / self._others_half
        parts.update(task)
        if self._flat:
            return _clipped(_joined(parts[name] for name in self._sizes))
        return {name: _clipped(parts[name]) for name in self._sizes}


def _box(size: int) -> Box:
    return Box(-1.0, 1.0, (size,), np.float32)


def _joined(arrays: Any) -> Array:
    return np.concatenate(list(arrays))


def _clipped(values: Array) -> NDArray[np.float32]:
    return np.clip(values, -1.0, 1.0).astype(np.float32)


def _ranges(robots: Sequence[Robot]) -> tuple[Array, Array]:
    """Return middle and half of the joints' ranges."""
    lower = np.concatenate([robot.lower for robot in robots] or [np.zeros(0)])
    upper = np.concatenate([robot.upper for robot in robots] or [np.zeros(0)])
    return 0.5 * (lower + upper), 0.5 * (upper - lower)
