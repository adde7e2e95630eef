"""One step of an environment in physical units, for tasks and reward functions."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf

import numpy as np
from numpy.typing import NDArray

from armgate.protocol.messages import Entry, Verdict

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ArmState:
    """State of one robot at its newest tick.

    Attributes:
        robot: Its name.
        tick: Number of the tick on its clock.
        q: Measured position (n,), rad or m.
        setpoint: Commanded position (n,), rad or m.
        increment: Increment that led to the setpoint (n,), rad or m.
        clearance: Smallest certified distance of the reported nearest pairs, m; inf if there is no pair.
        margin: The smallest of these distances less the distance to be kept, m; inf if there is no pair.
        stopped: True if a stop is in force for the robot.
    """

    robot: str
    tick: int
    q: Array
    setpoint: Array
    increment: Array
    clearance: float = inf
    margin: float = inf
    stopped: bool = False

    @classmethod
    def at(cls, entry: Entry, increment: Array) -> "ArmState":
        """Return the state of an entry that has all fields."""
        near = entry.nearest or ()
        return cls(
            entry.robot,
            entry.tick,
            np.array(entry.q),
            np.array(entry.setpoint),
            increment,
            min((pair.distance for pair in near), default=inf),
            min((pair.distance - pair.limit for pair in near), default=inf),
            bool(entry.stops),
        )


@dataclass(frozen=True, slots=True)
class Transition:
    """One step of an environment.

    Attributes:
        time: Virtual time after the step, s.
        arms: State of every robot of the cell after the step, by name.
        action: Action of the step, as the agent gave it.
        verdicts: Verdicts on the agent's commands in this step, in order.
        programs: Outcomes of the programs of other robots in words, by robot; "" while one runs.
        measures: Measures of the task, such as ``distance``.
        reward: Reward of the task, before a reward function.
        terminated: True if the task has ended.
    """

    time: float
    arms: Mapping[str, ArmState]
    action: Array
    verdicts: tuple[Verdict, ...] = ()
    programs: Mapping[str, str] = field(default_factory=dict)
    measures: Mapping[str, float] = field(default_factory=dict)
    reward: float = 0.0
    terminated: bool = False

    @property
    def refused(self) -> int:
        """Number of commands that the gate refused in this step."""
        return sum(verdict.outcome == "refused" for verdict in self.verdicts)

    @property
    def limited(self) -> int:
        """Number of commands that the gate limited in this step."""
        return sum(verdict.outcome == "limited" for verdict in self.verdicts)

    @property
    def beta(self) -> float:
        """Smallest β of the step's verdicts; 1 without a verdict."""
        return min((verdict.beta for verdict in self.verdicts), default=1.0)
