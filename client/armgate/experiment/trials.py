"""Trials of an experiment: the runs that its file describes."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache
from typing import assert_never

import numpy as np
from numpy.typing import NDArray

from armgate.control.spheres import Spheres
from armgate.experiment.experiment_file import Approach, Collision, Experiment, Tracking, Zoom
from armgate.experiment.paths import dash, joystick, straight
from armgate.experiment.scene import Scene, limit_starts, off_axis_start

Array = NDArray[np.float64]

LIMIT_SECONDS = 10.0
"""Duration of a run that starts at a joint limit, s."""


@dataclass(frozen=True)
class BodyPursuit:
    """Pursuit of a body of the follower: its name, and the speed of the leader's tool, m/s."""

    body: str
    speed: float


@dataclass(frozen=True)
class DistanceRange:
    """Random view distances of an operator: smallest and largest distance, m, and rate of change, m/s."""

    low: float
    high: float
    rate: float


@dataclass(frozen=True)
class Trial:
    """Run of leader and follower, and in some trials of an operator.

    Attributes:
        case: Case of the experiment.
        seed: Seed of its path, or number of its start.
        lag: Lag of the robots, s.
        distance: Wanted view distance, m.
        predict: True if the follower predicts the position of the leader's tool.
        focus: Fixed point that the camera is aimed at, m; None: the leader's tool.
        start: Start of the follower (n,); None for the configured start.
        path: Path of the leader's tool (k, 3), world, one sample per tick; None if it rests.
        pursuit: Body of the follower that the leader pursues from the beginning of ``path``; None if it plays
            ``path``.
        zoom: Wanted distances of an operator; None without an operator.
        seconds: Time for which the follower runs; None if it runs until the leader has finished.
    """

    case: str
    seed: int
    lag: float
    distance: float
    predict: bool = True
    focus: tuple[float, float, float] | None = None
    start: Array | None = field(default=None, compare=False)
    path: Array | None = field(default=None, compare=False)
    pursuit: BodyPursuit | None = None
    zoom: DistanceRange | None = None
    seconds: float | None = None

    @property
    def name(self) -> str:
        """Name of its folder."""
        return f"{self.case}-{self.seed}"


def trials(experiment: Experiment, scene: Scene, seeds: int | None = None) -> list[Trial]:
    """Return the runs of an experiment; ``seeds`` overrides its number of seeds."""
    numbers = range(experiment.first_seed, experiment.first_seed + (seeds or experiment.seeds))
    match experiment:
        case Approach():
            return list(_approaches(experiment, scene, numbers, None if seeds is None else 2 * seeds))
        case Tracking():
            return list(_tours(experiment, scene, numbers))
        case Zoom():
            return list(_zooms(experiment, scene, numbers))
        case Collision():
            return [*_dashes(experiment, scene, numbers), *_pursuits(experiment, scene, seeds)]
        case _:
            assert_never(experiment)


def _approaches(experiment: Approach, scene: Scene, seeds: range, limits: int | None) -> Iterator[Trial]:
    for seed in seeds:
        start = off_axis_start(scene, seed)
        yield Trial(
            "approach", seed, experiment.lag, experiment.distance, start=start, seconds=experiment.seconds
        )
    for number, start in enumerate(limit_starts(scene, experiment.limit_share)[:limits]):
        yield Trial("limit", number, experiment.lag, experiment.distance, start=start, seconds=LIMIT_SECONDS)


def _tours(experiment: Tracking, scene: Scene, seeds: range) -> Iterator[Trial]:
    middle, half = np.array(experiment.box.middle), np.array(experiment.box.half)
    period = scene.leader.period

    @cache
    def path(seed: int, speed: float) -> Array:
        return joystick(seed, speed, middle, half, seconds=experiment.seconds, period=period)

    for case in experiment.cases:
        for seed in seeds:
            own = path(seed, case.speed)
            yield Trial(case.name, seed, case.lag, experiment.distance, predict=case.predict, path=own)


def _zooms(experiment: Zoom, scene: Scene, seeds: range) -> Iterator[Trial]:
    middle, half = np.array(experiment.box.middle), np.array(experiment.box.half)
    period, speed = scene.leader.period, experiment.speed
    zoom = DistanceRange(experiment.low, experiment.high, experiment.rate)
    for seed in seeds:
        path = joystick(seed, speed, middle, half, seconds=experiment.seconds, period=period)
        yield Trial("zoom", seed, experiment.lag, experiment.distance, path=path, zoom=zoom)


def _dashes(experiment: Collision, scene: Scene, seeds: range) -> Iterator[Trial]:
    for speed in experiment.speeds:
        for seed in seeds:
            _, begin, end = _attack(experiment, scene, seed)
            path = straight(begin, end, speed, scene.leader.period)
            seconds = experiment.way / speed + experiment.seconds
            yield Trial(
                f"dash-{speed:g}", seed, experiment.lag, experiment.distance, focus=experiment.focus,
                path=path, seconds=seconds,
            )  # fmt: skip


def _pursuits(experiment: Collision, scene: Scene, seeds: int | None) -> Iterator[Trial]:
    own = experiment.pursuit
    if own is None:
        return
    count = own.seeds if seeds is None else min(seeds, own.seeds)
    for speed in own.speeds:
        for seed in range(experiment.first_seed, experiment.first_seed + count):
            body, begin, _ = _attack(experiment, scene, seed)
            yield Trial(
                f"pursuit-{speed:g}", seed, experiment.lag, experiment.distance, focus=experiment.focus,
                path=begin[None], pursuit=BodyPursuit(body, speed), seconds=own.seconds,
            )  # fmt: skip


def _attack(experiment: Collision, scene: Scene, seed: int) -> tuple[str, Array, Array]:
    """Return the link towards which the leader moves with this seed, and the start and end of its tool."""
    spheres = Spheres.of(scene.follower.model)
    links = sorted(set(spheres.bodies))
    link = links[seed % len(links)]
    centres = spheres.centres(scene.follower.start)
    place = centres[[body == link for body in spheres.bodies]].mean(axis=0)
    begin, end = dash(place, seed, experiment.way, *scene.reach())
    return scene.follower.model.bodies[link].name, begin, end
