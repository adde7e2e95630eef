"""Live display of a run in the terminal, and its form as one line of text."""

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.panel import Panel
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from armgate.apps.stack.metrics import ANGLE_BAND, DISTANCE_BAND
from armgate.apps.stack.observation import Observation, same_robot
from armgate.apps.stack.run import Watch
from armgate.cell.terminal_text import printable
from armgate.client import Description, Entry, Nearest

GAUGE = 31
"""Width of a gauge, characters; odd, so that zero has a character of its own."""
LINE_EVERY = 1.0
"""Daemon time between two lines of text, s."""


def picture(seen: Observation, cell: Description, factor: float | None) -> RenderableType:
    """Return the whole display.

    Args:
        seen: Observation so far.
        cell: Description of the cell: units of the joints, margins.
        factor: Speed of the run as a multiple of real time; None while unknown.
    """
    parts: list[RenderableType] = [
        _robots(seen, cell), Text(), _gate(seen), *_reasons(seen), Text(), _camera(seen), _path(seen),
    ]  # fmt: skip
    parts += [Text(f"! {printable(text)}", style="yellow") for text in seen.warnings[-3:]]
    mode = "lock-step" if cell.lockstep else "by the wall clock"
    speed = "" if factor is None else f" · {factor:.1f} × real time"
    title = Text(f"armgate · {printable(cell.name)} · {seen.elapsed:.1f} s {mode}{speed}")
    return Panel(Group(*parts), title=title, title_align="left", border_style="cyan", padding=(0, 1))


def line(seen: Observation) -> str:
    """Return the run as one line, for logs and pipes."""
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
    table = _table("robot", "tick", "driven by", "q")
    units = {robot.name: [joint.unit for joint in robot.joints] for robot in cell.robots}
    for entry in seen.entries:
        holder = Text(printable(entry.holder)) if entry.holder else Text(entry.link or "–", style="dim")
        q = _position(entry.q or (), units.get(entry.robot, []))
        table.add_row(Text(entry.robot, style="bold"), str(entry.tick), holder, q)
    return table


def _gate(seen: Observation) -> Table:
    """Return the gate's verdicts and the nearest pairs, as a separate table that fits into 80 columns."""
    table = _table("robot", "admitted", "limited", "refused", "nearest now")
    for entry in seen.entries:
        table.add_row(Text(entry.robot, style="bold"), *_counts(entry), _nearest(entry.nearest or ()))
    return table


def _table(*columns: str) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0))
    for name in columns:
        table.add_column(name, no_wrap=True, header_style="dim")
    return table


def _position(q: Sequence[float], units: Sequence[str]) -> str:
    """Return lengths in one line, angles in the next."""
    lengths = [f"{x:6.3f}" for x, unit in zip(q, units, strict=False) if unit == "m"]
    angles = [f"{math.degrees(x):6.1f}" for x, unit in zip(q, units, strict=False) if unit == "rad"]
    lines = [" ".join(lengths) + " m"] if lengths else []
    return "\n".join([*lines, " ".join(angles) + "°"] if angles else lines)


def tally(entry: Entry) -> tuple[int, int, int]:
    """Return the numbers of admitted, limited and refused commands of a robot."""
    sums = {"admitted": 0, "limited": 0, "refused": 0}
    for key, number in (entry.counts or {}).items():
        sums[key.partition(":")[0]] += number
    return sums["admitted"], sums["limited"], sums["refused"]


def _verdicts(entry: Entry) -> str:
    return "/".join(str(number) for number in tally(entry))


def _counts(entry: Entry) -> list[Text]:
    styles = ("green", "yellow", "red")
    return [
        Text(str(number), style=style if number else "dim")
        for number, style in zip(tally(entry), styles, strict=True)
    ]


def _nearest(near: Sequence[Nearest]) -> Text:
    """Return the nearest pair of different owners; a pair within the robot only if there is no other."""
    if not near:
        return Text("–", style="dim")
    nearest = min(near, key=lambda pair: (same_robot(pair.pair), pair.distance))
    margin = nearest.distance - nearest.limit
    style = "red" if margin < 0.0 else "yellow" if margin < 0.05 else "green"
    a, b = nearest.pair
    return Text.assemble((_millimetres(nearest.distance), style), f"  {a} – {b}")


def _reasons(seen: Observation) -> list[Text]:
    """Return the reasons that limited or refused the newest command of each robot."""
    return [
        Text(
            printable(f"{entry.robot} {entry.verdict.outcome}: {entry.verdict.text or entry.verdict.cause}"),
            style="dim",
        )
        for entry in seen.entries
        if entry.verdict is not None and entry.verdict.cause
    ]


def _camera(seen: Observation) -> Table:
    angle, distance = seen.scalar("follow.angle_error"), seen.scalar("follow.distance_error")
    table = Table(box=None, padding=(0, 2, 0, 0), show_header=False)
    table.add_row("view angle", *_gauge(None if angle is None else math.degrees(angle), ANGLE_BAND, "°", 2))
    in_mm = None if distance is None else 1000 * distance
    table.add_row("view distance", *_gauge(in_mm, 1000 * DISTANCE_BAND, " mm", 1))
    least = seen.least_clearance
    table.add_row("smallest clearance", Text(_millimetres(least)), _pair(seen))
    return table


def _pair(seen: Observation) -> Text:
    return Text("" if seen.nearest is None else " – ".join(seen.nearest[1]), style="dim")


def _gauge(value: float | None, band: float, unit: str, digits: int) -> tuple[Text, Text]:
    """Return the number, and a scale from −2 to +2 bands with a mark at the number."""
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


@contextmanager
def screen(terminal: bool, console: Console | None = None) -> Iterator[Callable[[Watch], None]]:
    """Yield a function that shows the run: as a live display in a terminal, otherwise as lines."""
    console = console or Console(highlight=False)
    if not terminal:
        yield Lines(console).show
        return
    with Live(console=console, auto_refresh=False, transient=False) as live:
        yield lambda watch: live.update(_picture(watch), refresh=True)


def _picture(watch: Watch) -> RenderableType:
    with watch.lock:
        return picture(watch.seen, watch.cell, watch.factor)


class Lines:
    """Display that prints a line after each second of daemon time."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._due = 0.0

    def show(self, watch: Watch) -> None:
        """Print a line if one is due."""
        with watch.lock:
            if watch.seen.state is None or watch.seen.elapsed < self._due:
                return
            self._due = watch.seen.elapsed + LINE_EVERY
            text = line(watch.seen)
        self._console.print(text, soft_wrap=True, markup=False)
