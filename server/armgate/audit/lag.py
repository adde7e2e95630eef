"""Measured lag of each joint of a recorded run: time constant and delay, for commissioning.

A joint with the time constant τ that follows the setpoint s with a delay of d ticks obeys, from tick to tick,

    q(k + 1) = q(k) + (1 − exp(−T/τ)) · (s(k − d) − q(k)).

All joints share the link's delay. For each delay, τ minimizes the mean square error between simulated and
measured motion; the delay minimizes the sum of these errors over the joints.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armgate.cell.cell import Cell, Robot
from armgate.events import Tick

Array = NDArray[np.float64]

_DELAYS = 9
_LAGS = np.geomspace(1e-3, 1.0, 49)
"""Time constants of the first round, s; each further round searches more finely around the best."""
_ROUNDS = 3
_MOVED = {"revolute": 0.01, "prismatic": 0.002}
"""Smallest motion of the setpoint for which the lag of a joint is measured, rad or m."""
_SHORTEST = 50
"""Smallest number of ticks of a stretch that is used."""
ROOM = 1.5
"""The proposed difference is the measured one times this factor, and at least `LEAST` times the lag."""
LEAST = 0.03


@dataclass(frozen=True, slots=True)
class RobotLags:
    """Measured lags of one robot.

    Attributes:
        robot: The robot.
        delay: Delay of the link, ticks.
        lags: Time constant by joint, s; only of joints that moved.
        errors: Root mean square error of the model by joint, rad or m.
        still: Joints that did not move far enough.
    """

    robot: Robot
    delay: int
    lags: dict[str, float]
    errors: dict[str, float]
    still: tuple[str, ...]

    @property
    def lag(self) -> float:
        """Middle between the smallest and the largest lag, s."""
        return (max(self.lags.values()) + min(self.lags.values())) / 2.0

    @property
    def difference(self) -> float:
        """Largest difference between the lags of two joints, s."""
        return max(self.lags.values()) - min(self.lags.values())

    @property
    def proposed(self) -> float:
        """Difference to declare, s."""
        return max(ROOM * self.difference, LEAST * self.lag)


def measure_lags(cell: Cell, robot: str, ticks: Iterable[Tick]) -> RobotLags | None:
    """Measure the lags of a robot of a recorded run; None if none of its joints moved far enough."""
    own = cell.robot(robot)
    runs = [run for run in _stretches(ticks, robot) if len(run) >= _SHORTEST]
    moved = [j for j in range(own.model.n) if _moves(own, j, runs)]
    still = tuple(joint.name for j, joint in enumerate(own.model.joints) if j not in moved)
    if not moved:
        return None
    fits = [_fit(own.period, runs, moved, delay) for delay in range(_DELAYS)]
    delay = int(np.argmin([(errors / _scale(runs, moved)).sum() for _, errors in fits]))
    lags, errors = fits[delay]
    names = [own.model.joints[j].name for j in moved]
    root = np.sqrt(errors)
    return RobotLags(
        own, delay, dict(zip(names, lags.tolist(), strict=True)),
        dict(zip(names, root.tolist(), strict=True)), still,
    )  # fmt: skip


def _stretches(ticks: Iterable[Tick], robot: str) -> list[list[Tick]]:
    """Return the ticks of a robot in stretches without a gap and without a jump of the setpoint."""
    runs: list[list[Tick]] = [[]]
    for tick in ticks:
        if tick.robot != robot:
            continue
        if runs[-1] and (tick.rebased or tick.tick != runs[-1][-1].tick + 1):
            runs.append([])
        runs[-1].append(tick)
    return runs


def _moves(robot: Robot, joint: int, runs: Sequence[Sequence[Tick]]) -> bool:
    far = _MOVED[robot.model.joints[joint].kind]
    return any(np.ptp([tick.setpoint[joint] for tick in run]) > far for run in runs)


def _scale(runs: Sequence[Sequence[Tick]], joints: Sequence[int]) -> Array:
    """Return the variance of the setpoint of each joint, by which the errors are normalized."""
    rows = np.concatenate([[tick.setpoint for tick in run] for run in runs])[:, joints]
    return np.asarray(rows.var(axis=0) + 1e-18)


def _fit(
    period: float, runs: Sequence[Sequence[Tick]], joints: Sequence[int], delay: int
) -> tuple[Array, Array]:
    """Return the best time constant of each joint, (n,), and its mean square error, (n,)."""
    tried = np.repeat(_LAGS[:, None], len(joints), axis=1)
    width = np.log(_LAGS[1] / _LAGS[0])
    every = np.arange(len(joints))
    for _ in range(_ROUNDS):
        errors = _errors(1.0 - np.exp(-period / tried), runs, joints, delay)
        best = np.argmin(errors, axis=0)
        lags, error = tried[best, every], errors[best, every]
        tried = lags * np.exp(np.linspace(-width, width, len(_LAGS))[:, None])
        width *= 2.0 / (len(_LAGS) - 1)
    return lags, error


def _errors(gains: Array, runs: Sequence[Sequence[Tick]], joints: Sequence[int], delay: int) -> Array:
    """Return the mean square errors of simulated motions, one for each gain, (m, n)."""
    total, count = np.zeros_like(gains), 0
    for run in runs:
        q = np.array([tick.q for tick in run])[:, joints]
        s = np.array([tick.setpoint for tick in run])[:, joints]
        at = np.broadcast_to(q[delay], gains.shape).copy()
        for k in range(delay, len(run) - 1):
            at += gains * (s[k - delay] - at)
            total += (at - q[k + 1]) ** 2
        count += len(run) - 1 - delay
    return total / count
