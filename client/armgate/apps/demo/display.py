"""The live picture of a run in the terminal, drawn from what was observed, and the same in one line."""

import math
from collections.abc import Sequence

from rich.console import Group, RenderableType
from rich.panel import Panel
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from armgate.apps.demo.metrics import ANGLE_BAND, DISTANCE_BAND
from armgate.apps.demo.observation import Observation
from armgate.client import Description, Entry, Nearest

GAUGE = 31
"""Width of a gauge in characters; odd, so that zero has a place of its own."""


def picture(seen: Observation, cell: Description, factor: float | None) -> RenderableType:
    """The whole display.

    Args:
        seen: What was observed so far.
        cell: The cell's description: units of the joints, distances kept.
        factor: How much faster than the clock the run goes, None if not known yet.
    """
    parts: list[RenderableType] = [_robots(seen, cell), _camera(seen), _path(seen)]
    parts += [Text(f"! {text}", style="yellow") for text in seen.warnings[-3:]]
    mode = "lock-step" if cell.lockstep else "by the clock"
    speed = "" if factor is None else f" · {factor:.1f} × real time"
    title = f"armgate · {cell.name} · {seen.elapsed:.1f} s {mode}{speed}"
    return Panel(Group(*parts), title=title, title_align="left", border_style="cyan", padding=(0, 1))


def line(seen: Observation) -> str:
    """The run in one line, for logs and pipes."""
    angle, distance = seen.scalar("follow.angle_error"), seen.scalar("follow.distance_error")
    progress = seen.scalar("lead.progress")
    words = [
        f"{seen.elapsed:6.1f} s",
        "path   –  " if progress is None else f"path {100 * progress:3.0f} %",
        "angle    –   " if angle is None else f"angle {math.degrees(angle):6.2f}°",
        "distance    –    " if distance is None else f"distance {1000 * distance:+6.1f} mm",
        f"clearance {_millimetres(seen.least_clearance)}",
        *(f"{entry.robot} {_verdicts(entry)}" for entry in seen.entries),
    ]
    return "  ".join(words)


def _robots(seen: Observation, cell: Description) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0), expand=True)
    for name in ("robot", "tick", "driven by"):
        table.add_column(name, no_wrap=True)
    table.add_column("q  (m, °)", ratio=1)
    table.add_column("let through / limited / refused", no_wrap=True)
    table.add_column("nearest now", no_wrap=True)
    units = {robot.name: [joint.unit for joint in robot.joints] for robot in cell.robots}
    for entry in seen.entries:
        table.add_row(
            Text(entry.robot, style="bold"),
            str(entry.tick),
            entry.holder or Text(entry.link or "–", style="dim"),
            _position(entry.q or (), units.get(entry.robot, [])),
            _counts(entry),
            _nearest(entry.nearest or ()),
        )
    return table


def _position(q: Sequence[float], units: Sequence[str]) -> str:
    return " ".join(
        f"{value:6.3f}" if unit == "m" else f"{math.degrees(value):6.1f}"
        for value, unit in zip(q, units, strict=False)
    )


def tally(entry: Entry) -> tuple[int, int, int]:
    """How many commands of a robot were admitted, limited and refused."""
    sums = {"admitted": 0, "limited": 0, "refused": 0}
    for key, number in (entry.counts or {}).items():
        sums[key.partition(":")[0]] += number
    return sums["admitted"], sums["limited"], sums["refused"]


def _verdicts(entry: Entry) -> str:
    return "/".join(str(number) for number in tally(entry))


def _counts(entry: Entry) -> Text:
    admitted, limited, refused = tally(entry)
    text = Text.assemble(
        (str(admitted), "green"), " / ", (str(limited), "yellow" if limited else "dim"),
        " / ", (str(refused), "red" if refused else "dim"),
    )  # fmt: skip
    if entry.verdict is not None and entry.verdict.cause:
        text.append(f"  last: {entry.verdict.cause}", style="dim")
    return text


def _nearest(near: Sequence[Nearest]) -> Text:
    """The pair that is tightest for its own limit."""
    if not near:
        return Text("–", style="dim")
    tightest = min(near, key=lambda pair: pair.distance - pair.limit)
    margin = tightest.distance - tightest.limit
    style = "red" if margin < 0.0 else "yellow" if margin < 0.05 else "green"
    a, b = tightest.pair
    return Text.assemble((_millimetres(tightest.distance), style), f"  {a} – {b}")


def _camera(seen: Observation) -> Table:
    angle, distance = seen.scalar("follow.angle_error"), seen.scalar("follow.distance_error")
    table = Table(box=None, padding=(1, 2, 0, 0), show_header=False)
    table.add_row("view angle", *_gauge(None if angle is None else math.degrees(angle), ANGLE_BAND, "°", 2))
    in_mm = None if distance is None else 1000 * distance
    table.add_row("view distance", *_gauge(in_mm, 1000 * DISTANCE_BAND, " mm", 1))
    least = seen.least_clearance
    table.add_row("smallest clearance", Text(_millimetres(least)), _pair(seen))
    return table


def _pair(seen: Observation) -> Text:
    return Text("" if seen.nearest is None else " – ".join(seen.nearest[1]), style="dim")


def _gauge(value: float | None, band: float, unit: str, digits: int) -> tuple[Text, Text]:
    """A number, and a mark on a scale of twice the band to both sides."""
    if value is None:
        return Text("–", style="dim"), Text("")
    style = "green" if abs(value) <= band else "red"
    middle = GAUGE // 2
    place = middle + round(max(-1.0, min(1.0, value / (2 * band))) * middle)
    edges = (middle - middle // 2, middle + middle // 2)
    scale = Text()
    for i in range(GAUGE):
        mark = "●" if i == place else "│" if i in edges else "┼" if i == middle else "─"
        scale.append(mark, style=style if i == place else "dim")
    number = Text(f"{value:+.{digits}f}{unit}", style=style)
    return number, scale + Text(f"  ± {band:g}{unit}", style="dim")


def _path(seen: Observation) -> Table:
    progress = seen.scalar("lead.progress") or 0.0
    table = Table(box=None, padding=(1, 2, 0, 0), show_header=False, expand=True)
    table.add_column(no_wrap=True)
    table.add_column(ratio=1)
    table.add_column(no_wrap=True)
    table.add_row("path", ProgressBar(total=1.0, completed=progress), f"{100 * progress:3.0f} %")
    return table


def _millimetres(metres: float | None) -> str:
    return "–" if metres is None else f"{1000 * metres:.0f} mm"
