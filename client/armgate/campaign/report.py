"""``report.html`` of a campaign: one self-contained page with claims, distributions and the worst trials."""

import html
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path

from armgate.campaign.campaign_file import CampaignConfig
from armgate.campaign.charts import Axis, colour, cumulative, histogram, number
from armgate.campaign.claims import Checked, figure_of
from armgate.campaign.figures import unit_of
from armgate.campaign.result import Result
from armgate.campaign.trials import Trial

SHOWN = ("min_clearance", "admitted_share", "refused_share", "beta_mean", "duration")
"""Built-in figures whose distributions are drawn, besides those of claims and own figures."""
LISTED = 20
"""Largest number of failed trials that are listed."""
_CSS = """
body { font: 15px/1.5 system-ui, sans-serif; color: #222; max-width: 64rem; margin: 2rem auto }
h1, h2, h3 { line-height: 1.2 } table { border-collapse: collapse; margin: 1rem 0; width: 100% }
td, th { text-align: left; padding: .3rem .6rem; border-bottom: 1px solid #ddd; vertical-align: top }
td.n { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap }
.yes { color: #1d7a3e; font-weight: 600 } .no { color: #b3261e; font-weight: 600 } .none { color: #777 }
.ended { background: #fbeceb; padding: .6rem 1rem; border-left: 3px solid #b3261e }
td.k { white-space: nowrap }
code { font-size: 13px; overflow-wrap: anywhere } svg text { font: 11px system-ui, sans-serif; fill: #555 }
figure { display: inline-block; margin: 0 1rem 1rem 0 } figcaption { font-size: 13px; color: #555 }
.key::before { content: "■ "; color: var(--c) } .key { margin-right: 1rem }
"""
_HOLDS = {
    True: '<td class="yes">holds</td>',
    False: '<td class="no">does not hold</td>',
    None: '<td class="none">not decided</td>',
}


def report_page(
    campaign: CampaignConfig,
    trials: Sequence[Trial],
    results: Mapping[str, Result],
    claims: Sequence[Checked],
    folder: Path,
) -> str:
    """Return the page.

    Args:
        campaign: The campaign.
        trials: Its trials.
        results: Results by key; trials without a result are missing in the page.
        claims: Checked claims.
        folder: Folder of the store, in which the page is written.
    """
    title = f"Campaign {campaign.name}"
    parts = [
        "<!doctype html>", '<html lang="en"><meta charset="utf-8">', f"<title>{html.escape(title)}</title>",
        f"<style>{_CSS}</style>", f"<h1>{html.escape(title)}</h1>", _summary(trials, results),
        "<h2>Claims</h2>", _claims(claims), "<h2>Worst trials of each claim</h2>",
        _worst(campaign, results, claims, folder), *_failures(campaign, trials, results, folder),
        "<h2>Distributions</h2>", _legend(campaign), *_distributions(campaign, trials, results, claims),
        "</html>",
    ]  # fmt: skip
    return "\n".join(parts) + "\n"


def reproduce(campaign: CampaignConfig, folder: Path, key: str) -> str:
    """Return the command that reproduces a trial."""
    words = ("armgate", "campaign", str(campaign.file), "--out", str(folder), "--trial", key)
    return shlex.join(words)


def _summary(trials: Sequence[Trial], results: Mapping[str, Result]) -> str:
    failed = sum(result.failed for result in results.values())
    text = f"<p>{len(results)} of {len(trials)} trials, {failed} failed.</p>"
    if len(results) == len(trials):
        return text
    return text + '<p class="ended"><b>Incomplete:</b> run the same command again to continue.</p>'


def _claims(claims: Sequence[Checked]) -> str:
    rows = []
    for one in claims:
        config = one.config
        sign = "≤" if config.at_most is not None else "≥"
        bound = config.at_most if config.at_most is not None else config.at_least
        goal = "–" if one.goal is None else f"{sign} {_value(one.goal, one.unit)}"
        if config.compared_with is not None:
            goal += f" ({number(bound or 0.0)} × {config.compared_with})"
        value = _value(one.value, one.unit)
        counted = f"{one.trials}" + (f", {one.missing} without the figure" if one.missing else "")
        rows.append(
            f"<tr><td>{html.escape(config.claim)}</td><td>{html.escape(config.aggregate)} of "
            f'<code>{html.escape(config.figure)}</code></td><td class="n">{html.escape(goal)}</td>'
            f'<td class="n">{value}</td><td class="n">{counted}</td>{_HOLDS[one.holds]}</tr>'
        )
    return _table(("claim", "figure", "goal", "value", "trials", ""), rows) if rows else "<p>None.</p>"


def _worst(
    campaign: CampaignConfig, results: Mapping[str, Result], claims: Sequence[Checked], folder: Path
) -> str:
    parts = []
    for one in claims:
        rows = [
            _row(campaign, folder, trial, _value(value, unit_of(one.config.figure, campaign.figures)))
            for trial, value in one.worst
        ]
        if rows:
            parts += [f"<h3>{html.escape(one.config.claim)}</h3>", _trial_table(rows, one.config.figure)]
    note = "<p>A link leads to the recording of a trial, once the trial was reproduced.</p>"
    return "\n".join([note, *parts]) if parts else "<p>None.</p>"


def _failures(
    campaign: CampaignConfig, trials: Sequence[Trial], results: Mapping[str, Result], folder: Path
) -> list[str]:
    found = [trial for trial in trials if trial.key in results and results[trial.key].failed]
    if not found:
        return []
    rows = [_row(campaign, folder, trial, results[trial.key].reason) for trial in found[:LISTED]]
    more = f"<p>… and {len(found) - LISTED} more.</p>" if len(found) > LISTED else ""
    return ["<h2>Failed trials</h2>", _trial_table(rows, "reason"), more]


def _row(campaign: CampaignConfig, folder: Path, trial: Trial, text: str) -> str:
    where = f"trials/{trial.key}"
    explain = shlex.join(("armgate", "explain", str(folder / where), "--refused"))
    return (
        f'<tr><td class="k"><code>{trial.key}</code></td><td>{html.escape(trial.scenario)}</td>'
        f'<td>{html.escape(trial.controllers)}</td><td class="n">{trial.seed}</td>'
        f"<td>{html.escape(text)}</td>"
        f"<td>reproduce: <code>{html.escape(reproduce(campaign, folder, trial.key))}</code><br>"
        f'then explain: <a href="{where}/"><code>{html.escape(explain)}</code></a></td></tr>'
    )


def _trial_table(rows: Sequence[str], last: str) -> str:
    return _table(("key", "scenario", "controllers", "seed", last, ""), rows)


def _legend(campaign: CampaignConfig) -> str:
    keys = "".join(
        f'<span class="key" style="--c: {colour(at)}">{html.escape(name)}</span>'
        for at, name in enumerate(campaign.controllers)
    )
    return f"<p>{keys} Dashed: the goal of a claim.</p>"


def _distributions(
    campaign: CampaignConfig,
    trials: Sequence[Trial],
    results: Mapping[str, Result],
    claims: Sequence[Checked],
) -> list[str]:
    goals = {
        one.config.figure: one.goal for one in reversed(claims) if one.config.aggregate in ("min", "max")
    }
    names = dict.fromkeys([one.config.figure for one in claims] + list(campaign.figures) + list(SHOWN))
    return [_figure(campaign, trials, results, name, goals.get(name)) for name in names]


def _figure(
    campaign: CampaignConfig,
    trials: Sequence[Trial],
    results: Mapping[str, Result],
    name: str,
    goal: float | None,
) -> str:
    found: dict[str, dict[str, list[float]]] = {
        scenario: {controllers: [] for controllers in campaign.controllers} for scenario in campaign.scenarios
    }
    for trial in trials:
        value = figure_of(results[trial.key], name) if trial.key in results else None
        if value is not None:
            found[trial.scenario][trial.controllers].append(value)
    unit = unit_of(name, campaign.figures)
    head = f"<h3><code>{html.escape(name)}</code>{f' [{html.escape(unit)}]' if unit else ''}</h3>"
    pictures = [_pictures(scenario, groups, goal) for scenario, groups in found.items()]
    return head + ("".join(pictures) or "<p>No values.</p>")


def _pictures(scenario: str, groups: Mapping[str, Sequence[float]], goal: float | None) -> str:
    values = [value for group in groups.values() for value in group]
    if not values:
        return ""
    axis = Axis(values)
    return "".join(
        f"<figure>{draw(groups, axis, goal)}<figcaption>{html.escape(scenario)}: {what}</figcaption></figure>"
        for draw, what in ((histogram, "histogram"), (cumulative, "cumulative share"))
    )


def _value(value: float | None, unit: str) -> str:
    return "–" if value is None else f"{number(value)} {unit}".strip()


def _table(heads: Sequence[str], rows: Sequence[str]) -> str:
    head = "".join(f"<th>{html.escape(text)}</th>" for text in heads)
    return f"<table><tr>{head}</tr>{''.join(rows)}</table>"
