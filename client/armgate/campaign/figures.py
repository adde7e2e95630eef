"""Figures of one trial: the built-in ones, and those of Python functions."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

import numpy as np

from armgate.campaign.campaign_file import FigureConfig
from armgate.campaign.entries import load_entry
from armgate.campaign.errors import CampaignError
from armgate.campaign.series import Array, RobotSeries, Series
from armgate.events import Outcome, Verdict

Figures = dict[str, float]
"""Figures by name; a figure that a trial does not have is absent."""
FAILED = "failed"
"""Figure of every trial: 1 if it failed, else 0."""
SIGNAL = "signal."
"""Beginning of the figures of signals: ``signal.NAME.max``, ``.rms`` and ``.last``."""

UNITS: dict[str, str] = {
    "duration": "s",
    "min_clearance": "m",
    "commands": "",
    "admitted": "",
    "limited": "",
    "refused": "",
    "admitted_share": "",
    "limited_share": "",
    "refused_share": "",
    "late": "",
    "beta_min": "",
    "beta_mean": "",
    "beta_p5": "",
}
"""Built-in figures of the whole cell, and their units."""
ROBOT_UNITS: dict[str, str] = {
    **{name: unit for name, unit in UNITS.items() if name != "duration"},
    "tracking_max": "rad or m",
    "tracking_rms": "rad or m",
    "travel": "rad or m",
    "energy": "rad²/s or m²/s",
}
"""Built-in figures of one robot, named ``ROBOT.FIGURE``, and their units."""


class FigureError(CampaignError):
    """Figure of a Python function that cannot be used."""


def compute(series: Series, own: Mapping[str, FigureConfig], functions: Mapping[str, Any]) -> Figures:
    """Return all figures of a trial, by name in alphabetical order.

    Args:
        series: Series of the trial.
        own: Own figures of the campaign.
        functions: Their functions by name, see `load_functions`.

    Raises:
        FigureError: A function returned something other than a finite number or None.
    """
    found = dict(_built_in(series))
    for name, config in own.items():
        value = functions[name](series, **config.options)
        if value is not None:
            found[name] = _checked(name, value)
    return dict(sorted(found.items()))


def load_functions(own: Mapping[str, FigureConfig], folder: Any) -> dict[str, Callable[..., Any]]:
    """Return the functions of own figures by name.

    Raises:
        EntryError: A function cannot be imported.
    """
    return {name: load_entry(config.function, folder) for name, config in own.items()}


def known_figures(robots: Iterable[str], own: Iterable[str]) -> list[str]:
    """Return the names of all figures that are known before a trial runs."""
    per_robot = [f"{robot}.{figure}" for robot in robots for figure in ROBOT_UNITS]
    return [FAILED, *UNITS, *per_robot, *own]


def unit_of(name: str, own: Mapping[str, FigureConfig]) -> str:
    """Return the unit of a figure; "" if it has none."""
    if name in own:
        return own[name].unit
    return UNITS.get(name) or ROBOT_UNITS.get(name.rpartition(".")[2], "")


def _checked(name: str, value: Any) -> float:
    if isinstance(value, bool | int | float | np.floating | np.integer | np.bool_) and math.isfinite(value):
        return float(value)
    raise FigureError(f"figure {name} is {value!r}; expected a finite number, or None for no value")


def _built_in(series: Series) -> Iterator[tuple[str, float]]:
    yield "duration", series.time
    yield from _decisions([one for robot in series.robots.values() for one in robot.verdicts])
    yield from _totals(series.robots.values())
    for name, robot in series.robots.items():
        own = (*_decisions(robot.verdicts), *_totals([robot]), *_motion(robot))
        yield from ((f"{name}.{figure}", value) for figure, value in own)
    for name, (_, values) in series.signals.items():
        yield from _signal(f"{SIGNAL}{name}", values)


def _decisions(verdicts: list[Verdict]) -> Iterator[tuple[str, float]]:
    """Yield the counts of outcomes and the distribution of β."""
    count = len(verdicts)
    yield "commands", float(count)
    for outcome in Outcome:
        number = sum(verdict.outcome is outcome for verdict in verdicts)
        yield outcome.value, float(number)
        if count:
            yield f"{outcome.value}_share", number / count
    if count:
        betas = np.array([verdict.beta for verdict in verdicts])
        yield "beta_min", float(betas.min())
        yield "beta_mean", float(betas.mean())
        yield "beta_p5", float(np.percentile(betas, 5.0))


def _totals(robots: Iterable[RobotSeries]) -> Iterator[tuple[str, float]]:
    entries = [robot.last for robot in robots if robot.last is not None]
    near = [entry.least_clearance for entry in entries if entry.least_clearance is not None]
    yield "late", float(sum(entry.late_commands or 0 for entry in entries))
    if near:
        yield "min_clearance", min(near)


def _motion(robot: RobotSeries) -> Iterator[tuple[str, float]]:
    """Yield tracking error, travel and energy.

    Tracking error: |setpoint − q|, largest joint. Travel: Σ|Δq| over ticks and joints. Energy: the integral
    of the squared joint speeds, Σ Δq² / T.
    """
    if len(robot.time) < 2:
        return
    q, setpoint = np.array(robot.q), np.array(robot.setpoint)
    error = np.abs(setpoint - q).max(axis=1)
    yield "tracking_max", float(error.max())
    yield "tracking_rms", float(np.sqrt(np.mean(error**2)))
    moves, times = np.diff(q, axis=0), np.diff(np.array(robot.time))
    yield "travel", float(np.abs(moves).sum())
    yield "energy", float((moves**2 / times[:, None]).sum())


def _signal(name: str, values: list[tuple[float, ...]]) -> Iterator[tuple[str, float]]:
    """Yield largest magnitude, RMS and last value of a signal; for a vector, of its length."""
    sizes: Array = np.array([value[0] if len(value) == 1 else math.hypot(*value) for value in values])
    yield f"{name}.max", float(np.abs(sizes).max())
    yield f"{name}.rms", float(np.sqrt(np.mean(sizes**2)))
    yield f"{name}.last", float(sizes[-1])
