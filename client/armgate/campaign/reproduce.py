"""Reproduction of one trial: run it again with a recording, and compare its figures with the store."""

import shlex
from collections.abc import Iterator
from pathlib import Path

from armgate.campaign.charts import number
from armgate.campaign.drive import Campaign
from armgate.campaign.errors import CampaignError, UsageError
from armgate.campaign.figures import unit_of
from armgate.campaign.laboratory import Laboratory
from armgate.campaign.result import Result
from armgate.campaign.store import MANIFEST, check_manifest, read_results
from armgate.campaign.trials import Trial
from armgate.cell.compilation import announced

TRIALS = "trials"
"""Folder of the reproduced trials in a store."""


def reproduce_trial(campaign: Campaign, folder: Path, key: str) -> Iterator[str]:
    """Run a trial again, and yield lines about it.

    Args:
        campaign: The campaign.
        folder: Folder of the store; it may not exist yet.
        key: Key of the trial, or its beginning.

    Raises:
        UsageError: There is no such trial, or the store belongs to another campaign.
        CampaignError: The trial failed, or its figures differ from the stored ones.
    """
    trial = find(campaign, key)
    stored = _stored(campaign, folder, trial)
    where = folder / TRIALS / trial.key
    yield f"{trial.key}: {trial.scenario}, {trial.controllers}, seed {trial.seed}"
    yield from (f"  {name} = {value}" for name, value in trial.values)
    with announced():
        result = Laboratory(campaign.config, campaign.basis).run(trial, _emptied(where))
    yield from _figures(campaign, result)
    explain = shlex.join(("armgate", "explain", str(where), "--refused"))
    yield f"recording: {where}; explain it with: {explain}"
    yield _compared(result, stored)
    if result.failed:
        raise CampaignError(f"{trial.key}: the trial failed: {result.reason}")


def find(campaign: Campaign, key: str) -> Trial:
    """Return the trial whose key begins with a text.

    Raises:
        UsageError: There is none, or there are several.
    """
    found = [trial for trial in campaign.trials if trial.key.startswith(key)]
    if len(found) == 1:
        return found[0]
    some = ", ".join(trial.key for trial in (found or campaign.trials)[:3])
    raise UsageError(
        f"--trial {key}: {len(found) or 'no'} trials have this key; expected one key, such as {some}"
    )


def _stored(campaign: Campaign, folder: Path, trial: Trial) -> Result | None:
    if not (folder / MANIFEST).exists():
        return None
    check_manifest(folder / MANIFEST, campaign.manifest)
    return read_results(folder).get(trial.key)


def _emptied(folder: Path) -> Path:
    """Return the folder without the recording of an earlier reproduction."""
    for old in folder.glob("*.mcap"):
        old.unlink()
    return folder


def _figures(campaign: Campaign, result: Result) -> Iterator[str]:
    for name, value in result.figures.items():
        if "." not in name:
            yield f"  {name}: {number(value)} {unit_of(name, campaign.config.figures)}".rstrip()


def _compared(result: Result, stored: Result | None) -> str:
    """Return a line about the comparison with the stored result.

    Raises:
        CampaignError: They differ.
    """
    if stored is None:
        return "not compared: the store has no result of this trial yet"
    if stored == result:
        return "equal to the stored result, bit by bit"
    before, now = dict(stored.figures), dict(result.figures)
    changed = [name for name in sorted(before.keys() | now.keys()) if before.get(name) != now.get(name)]
    names = ", ".join(changed[:5]) or "the reason"
    raise CampaignError(
        f"{result.key}: differs from the stored result in {names}; a controller uses a clock, unseeded "
        "random numbers or a file that changed"
    )
