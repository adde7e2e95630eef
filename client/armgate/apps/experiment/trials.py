"""Trials of an experiment: the runs of the stack that its file describes."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache
from typing import assert_never

import numpy as np
from numpy.typing import NDArray

from armgate.apps.experiment.experiment_file import Approach, Collision, Experiment, Tracking, Zoom
from armgate.apps.experiment.paths import dash, joystick, straight
from armgate.apps.experiment.scene import Scene, limit_starts, off_axis_start
from armgate.control.spheres import Spheres

Array = NDArray[np.float64]

LIMIT_SECONDS = 10.0
"""Duration of a run that starts at a joint limit, s."""


@dataclass(frozen=True)
class Trial:
    """Run of the stack.

    Attributes:
        case: Case of the experiment.
        seed: Seed of its path, or number of its start.
        lag: Lag of the robots, s.
        follow: Options of ``armgate follow``.
        start: Start of the follower (n,); None for the configured start.
        path: Path of the leader's tool (k, 3), world, one sample per tick; None if it rests.
        pursue: Options of ``armgate lead`` with which the leader starts at the beginning of ``path`` and
            pursues the follower; None if it plays ``path``.
        zoom: Options of ``armgate zoom``; None without zoom.
        seconds: Time for which the follower runs; None if it runs until the leader has finished.
    """

    case: str
    seed: int
    lag: float
    follow: tuple[str, ...] = ()
    start: Array | None = field(default=None, compare=False)
    path: Array | None = field(default=None, compare=False)
    pursue: tuple[str, ...] | None = None
    zoom: tuple[str, ...] | None = None
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


def _view(experiment: Experiment) -> tuple[str, ...]:
    return ("--distance", str(experiment.distance))


def _approaches(experiment: Approach, scene: Scene, seeds: range, limits: int | None) -> Iterator[Trial]:
    for seed in seeds:
        start = off_axis_start(scene, seed)
        yield Trial(
            "approach", seed, experiment.lag, _view(experiment), start=start, seconds=experiment.seconds
        )
    for number, start in enumerate(limit_starts(scene, experiment.limit_share)[:limits]):
        yield Trial("limit", number, experiment.lag, _view(experiment), start=start, seconds=LIMIT_SECONDS)


def _tours(experiment: Tracking, scene: Scene, seeds: range) -> Iterator[Trial]:
    middle, half = np.array(experiment.box.middle), np.array(experiment.box.half)
    period = scene.leader.period

    @cache
    def path(seed: int, speed: float) -> Array:
        return joystick(seed, speed, middle, half, seconds=experiment.seconds, period=period)

    for case in experiment.cases:
        predict = "--predict" if case.predict else "--no-predict"
        for seed in seeds:
            own = path(seed, case.speed)
            yield Trial(case.name, seed, case.lag, (*_view(experiment), predict), path=own)


def _zooms(experiment: Zoom, scene: Scene, seeds: range) -> Iterator[Trial]:
    middle, half = np.array(experiment.box.middle), np.array(experiment.box.half)
    period, speed = scene.leader.period, experiment.speed
    zoom: tuple[str, ...] = (
        "--low",
        str(experiment.low),
        "--high",
        str(experiment.high),
        "--rate",
        str(experiment.rate),
    )
    zoom += ("--start", str(experiment.distance))
    for seed in seeds:
        path = joystick(seed, speed, middle, half, seconds=experiment.seconds, period=period)
        own = (*zoom, "--seed", str(seed))
        yield Trial("zoom", seed, experiment.lag, _view(experiment), path=path, zoom=own)


def _dashes(experiment: Collision, scene: Scene, seeds: range) -> Iterator[Trial]:
    lag, focus = experiment.lag, _fixed_focus(experiment)
    for speed in experiment.speeds:
        for seed in seeds:
            _, begin, end = _attack(experiment, scene, seed)
            path = straight(begin, end, speed, scene.leader.period)
            seconds = experiment.way / speed + experiment.seconds
            yield Trial(f"dash-{speed:g}", seed, lag, focus, path=path, seconds=seconds)


def _pursuits(experiment: Collision, scene: Scene, seeds: int | None) -> Iterator[Trial]:
    own = experiment.pursuit
    if own is None:
        return
    count = own.seeds if seeds is None else min(seeds, own.seeds)
    for speed in own.speeds:
        for seed in range(experiment.first_seed, experiment.first_seed + count):
            body, begin, _ = _attack(experiment, scene, seed)
            pursue = ("--pursue", f"{scene.follower.name}/{body}", "--tool-speed", str(speed))
            yield Trial(
                f"pursuit-{speed:g}", seed, experiment.lag, _fixed_focus(experiment), path=begin[None],
                pursue=pursue, seconds=own.seconds,
            )  # fmt: skip


def _fixed_focus(experiment: Collision) -> tuple[str, ...]:
    return (*_view(experiment), "--focus", *map(str, experiment.focus))


def _attack(experiment: Collision, scene: Scene, seed: int) -> tuple[str, Array, Array]:
    """Return the link towards which the leader moves with this seed, and the start and end of its tool."""
    spheres = Spheres.of(scene.follower.model)
    links = sorted(set(spheres.bodies))
    link = links[seed % len(links)]
    centres = spheres.centres(scene.follower.start)
    place = centres[[body == link for body in spheres.bodies]].mean(axis=0)
    begin, end = dash(place, seed, experiment.way, *scene.reach())
    return scene.follower.model.bodies[link].name, begin, end
