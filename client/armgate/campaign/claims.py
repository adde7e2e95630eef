"""Claims of a campaign, checked against the results."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from armgate.campaign.campaign_file import CampaignConfig, ClaimConfig
from armgate.campaign.figures import FAILED, SIGNAL, known_figures, unit_of
from armgate.campaign.result import Result
from armgate.campaign.trials import Trial
from armgate.cell.config.yaml_tree import KeyPath

WORST = 5
"""Number of trials that are listed as the worst of a claim."""

_AGGREGATES: Mapping[str, Callable[[Any], Any]] = {
    "min": np.min,
    "max": np.max,
    "mean": np.mean,
    "median": np.median,
    "sum": np.sum,
    "share": lambda values: np.mean(np.asarray(values) != 0.0),
}


@dataclass(frozen=True)
class Checked:
    """Claim with its outcome.

    Attributes:
        config: The claim.
        value: Aggregate of the figures; None if no trial has the figure.
        goal: Bound of the value; None if the controllers to compare with have no value.
        holds: True if the claim holds; None if it cannot be decided.
        trials: Number of trials that count.
        missing: Number of those that lack the figure.
        unit: Unit of value and goal.
        worst: Trials nearest to or beyond the goal, with their figures.
    """

    config: ClaimConfig
    value: float | None
    goal: float | None
    holds: bool | None
    trials: int
    missing: int
    unit: str
    worst: tuple[tuple[Trial, float], ...]


def check_claims(
    campaign: CampaignConfig, trials: Sequence[Trial], results: Mapping[str, Result], *, complete: bool
) -> list[Checked]:
    """Return the claims with their outcomes.

    Args:
        campaign: The campaign.
        trials: Its trials.
        results: Results by key.
        complete: True if all trials have a result; otherwise a claim may fail, but none holds.
    """
    return [_check(campaign, claim, trials, results, complete) for claim in campaign.claims]


def check_figures(campaign: CampaignConfig, robots: Sequence[str]) -> None:
    """Check that every claim names a figure that can exist.

    Raises:
        ConfigError: A claim names an unknown figure.
    """
    known = known_figures(robots, campaign.figures)
    for at, claim in enumerate(campaign.claims):
        if claim.figure not in known and not claim.figure.startswith(SIGNAL):
            where: KeyPath = ("claims", at, "figure")
            names = ", ".join(name for name in known if "." not in name)
            raise campaign.error(
                where, f"there is no figure {claim.figure!r}; expected one of {names}, ROBOT.… or {SIGNAL}…"
            )


def figure_of(result: Result, name: str) -> float | None:
    """Return a figure of a result; None if it has none."""
    return float(result.failed) if name == FAILED else result.figures.get(name)


def aggregate(name: str, values: Sequence[float]) -> float | None:
    """Return an aggregate of values, such as ``max`` or ``p95``; None without values."""
    if not len(values):
        return None
    if name in _AGGREGATES:
        return float(_AGGREGATES[name](values))
    return float(np.percentile(values, float(name.removeprefix("p"))))


def _check(
    campaign: CampaignConfig,
    claim: ClaimConfig,
    trials: Sequence[Trial],
    results: Mapping[str, Result],
    complete: bool,
) -> Checked:
    own = [trial for trial in trials if _counts(claim, trial) and trial.key in results]
    figures = [(trial, figure_of(results[trial.key], claim.figure)) for trial in own]
    known = [(trial, value) for trial, value in figures if value is not None]
    value = aggregate(claim.aggregate, [value for _, value in known])
    goal = _goal(claim, trials, results)
    missing = len(own) - len(known)
    holds = _holds(claim, value, goal, missing)
    return Checked(
        claim, value, goal, holds if complete or holds is False else None, len(own), missing,
        "" if claim.aggregate == "share" else unit_of(claim.figure, campaign.figures), _worst(claim, known),
    )  # fmt: skip


def _counts(claim: ClaimConfig, trial: Trial) -> bool:
    if claim.scenarios and trial.scenario not in claim.scenarios:
        return False
    if claim.controllers:
        return trial.controllers in claim.controllers
    return trial.controllers != claim.compared_with


def _goal(claim: ClaimConfig, trials: Sequence[Trial], results: Mapping[str, Result]) -> float | None:
    bound = claim.at_most if claim.at_most is not None else claim.at_least
    assert bound is not None
    if claim.compared_with is None:
        return bound
    base = claim.model_copy(update={"controllers": (claim.compared_with,)})
    others = [results[trial.key] for trial in trials if _counts(base, trial) and trial.key in results]
    found = [value for one in others if (value := figure_of(one, claim.figure)) is not None]
    value = aggregate(claim.aggregate, found)
    return None if value is None else bound * value


def _holds(claim: ClaimConfig, value: float | None, goal: float | None, missing: int) -> bool | None:
    """Return the outcome; a trial without the figure, such as a failed one, does not support a claim."""
    if value is None or goal is None:
        return None
    inside = value <= goal if claim.at_most is not None else value >= goal
    return inside and not missing


def _worst(claim: ClaimConfig, known: Sequence[tuple[Trial, float]]) -> tuple[tuple[Trial, float], ...]:
    sign = -1.0 if claim.at_most is not None else 1.0
    return tuple(sorted(known, key=lambda one: (sign * one[1], one[0].key))[:WORST])
