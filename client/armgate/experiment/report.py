"""``report.html``: a self-contained page with the figures of armgate beside those of the paper."""

import base64
import html
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from armgate.experiment.claims import Claim, digits

PAPER = {
    "approach": "Three approaches; the angle falls monotonically, the distance does not always (figure 8).",
    "tracking": "Angle within ± 1°, distance within ± 2 cm, leader by gamepad (figure 9).",
    "zoom": "The wanted distance is not reached while repulsion acts; the angle is unaffected (figure 10).",
    "collision": (
        "The focus is kept while equation (13) is inactive; repulsion has priority over distance (figure 11)."
    ),
}
"""Results that the paper reports for each experiment."""
SOURCE = (
    "Bjerkeng, Transeth, Pettersen, Kyrkjebø, Fjerdingen: Active camera control with obstacle avoidance for "
    "remote operations with industrial manipulators: Implementation and experimental results"
)
_CSS = """
body { font: 15px/1.5 system-ui, sans-serif; color: #222; max-width: 60rem; margin: 2rem auto; padding: 1rem }
h1, h2 { line-height: 1.2 } table { border-collapse: collapse; margin: 1rem 0; width: 100% }
td, th { text-align: left; padding: .3rem .6rem; border-bottom: 1px solid #ddd; vertical-align: top }
td.n { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap }
td.g { white-space: nowrap }
.yes { color: #1d7a3e; font-weight: 600 } .no { color: #b3261e; font-weight: 600 } .none { color: #777 }
img { max-width: 100% } .paper { background: #f3f5f7; padding: .6rem 1rem; border-left: 3px solid #1f4e79 }
.ended { background: #fbeceb; padding: .6rem 1rem; border-left: 3px solid #b3261e }
"""
_HOLDS = {
    True: '<td class="yes">holds</td>',
    False: '<td class="no">does not hold</td>',
    None: '<td class="none">–</td>',
}


def page(
    experiment: str,
    claims: Sequence[Claim],
    aggregate: Mapping[str, Any],
    pictures: Sequence[tuple[str, Path]],
    *,
    ended: str = "",
) -> str:
    """Return the page.

    Args:
        experiment: Name of the experiment.
        claims: Claims of the experiment.
        aggregate: Sums by case, as in ``metrics.json``.
        pictures: Captions and PNG files, which are embedded.
        ended: Reason why runs are missing; "" if the experiment is complete.
    """
    title = f"armgate: {experiment}"
    parts = [
        "<!doctype html>", '<html lang="en"><meta charset="utf-8">', f"<title>{html.escape(title)}</title>",
        f"<style>{_CSS}</style>", f"<h1>{html.escape(title)}</h1>",
        f'<p class="paper"><b>The paper:</b> {html.escape(PAPER[experiment])}</p>',
        *([f'<p class="ended"><b>Incomplete:</b> {html.escape(ended)}</p>'] if ended else []),
        "<h2>Claims</h2>", _claims(claims), "<h2>Cases</h2>", _cases(aggregate), "<h2>Pictures</h2>",
        *(_picture(caption, file) for caption, file in pictures), f"<p>Paper: {html.escape(SOURCE)}.</p>",
        "</html>",
    ]  # fmt: skip
    return "\n".join(parts) + "\n"


def _claims(claims: Sequence[Claim]) -> str:
    rows = [
        f'<tr><td>{html.escape(c.claim)}</td><td>{html.escape(c.paper) or "–"}</td>'
        f'<td class="g">{html.escape(c.goal)}</td>'
        f'<td class="n">{html.escape(c.text)}</td>{_HOLDS[c.holds]}</tr>'
        for c in claims
    ]  # fmt: skip
    note = "<p>Figures of armgate are the worst of all runs; a share counts all runs together.</p>"
    return _table(("claim", "paper", "goal", "armgate", ""), rows) + note


def _cases(aggregate: Mapping[str, Any]) -> str:
    rows = []
    for case, sums in aggregate.items():
        angle, distance = sums["angle_error_deg"], sums["distance_error_m"]
        cells = (
            str(sums["runs"]), f"{_number(angle['max'])}° / {_number(angle['rms'])}°",
            f"{_number(distance['max'], 1000)} / {_number(distance['rms'], 1000)} mm",
            f"{_number(sums['min_clearance_m'], 1000)} mm", _robots(sums["limited"]),
            _robots(sums["refused"]),
            f"{_number(sums['realtime_factor'])} ×",
        )  # fmt: skip
        numbers = "".join(f'<td class="n">{cell}</td>' for cell in cells)
        rows.append(f'<tr><td class="g">{html.escape(case)}</td>{numbers}</tr>')
    heads = (
        "case",
        "runs",
        "angle, max / RMS",
        "distance, max / RMS",
        "smallest clearance",
        "limited",
        "refused",
        "speed",
    )
    return _table(heads, rows)


def _robots(numbers: Mapping[str, int]) -> str:
    return ", ".join(f"{html.escape(name)} {number}" for name, number in numbers.items())


def _table(heads: Sequence[str], rows: Sequence[str]) -> str:
    head = "".join(f"<th>{html.escape(text)}</th>" for text in heads)
    return f"<table><tr>{head}</tr>{''.join(rows)}</table>"


def _picture(caption: str, file: Path) -> str:
    data = base64.b64encode(file.read_bytes()).decode("ascii")
    text = html.escape(caption)
    image = f'<img alt="{text}" src="data:image/png;base64,{data}">'
    return f"<figure>{image}<figcaption>{text}</figcaption></figure>"


def _number(value: float | None, scale: float = 1.0) -> str:
    return "–" if value is None else digits(scale * value)
