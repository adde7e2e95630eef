"""Progress of the experiments: bars in a terminal, otherwise a line per run."""

import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Protocol

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TaskID, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bars

from armgate.apps.stack.run import Watch


class Progress(Protocol):
    """Display of the experiments' progress."""

    def begin(self, name: str, runs: int) -> None:
        """Begin an experiment with this number of runs."""

    def show(self, watch: Watch) -> None:
        """Show a run in progress."""

    def done(self, name: str, entry: Mapping[str, Any]) -> None:
        """Show the result of a run."""


@contextmanager
def progress(console: Console | None = None) -> Iterator[Progress]:
    """Yield bars in a terminal, otherwise lines."""
    console = console or Console(highlight=False)
    if not sys.stdout.isatty():
        yield Lines(console)
        return
    columns = (
        TextColumn("{task.description:10}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(),
        TextColumn("{task.fields[now]}", style="dim"),
    )  # fmt: skip
    with Bars(*columns, console=console) as bars:
        yield InTerminal(bars)


class Lines:
    """Display with a line per run."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._runs = self._number = 0

    def begin(self, name: str, runs: int) -> None:
        """Print the experiment and its number of runs."""
        self._runs, self._number = runs, 0
        self._console.print(f"{name}: {runs} runs")

    def show(self, watch: Watch) -> None:
        """Print nothing."""

    def done(self, name: str, entry: Mapping[str, Any]) -> None:
        """Print the result of a run."""
        self._number += 1
        self._console.print(f"{self._number:4}/{self._runs}  {name:28} {outcome(entry)}", soft_wrap=True)


class InTerminal:
    """Display with a bar per experiment."""

    def __init__(self, bars: Bars) -> None:
        self._bars = bars
        self._task: TaskID | None = None

    def begin(self, name: str, runs: int) -> None:
        """Add a bar."""
        self._task = self._bars.add_task(name, total=runs, now="")

    def show(self, watch: Watch) -> None:
        """Show the time of the run."""
        if self._task is not None:
            with watch.lock:
                self._bars.update(self._task, now=f"{watch.seen.elapsed:5.1f} s")

    def done(self, name: str, entry: Mapping[str, Any]) -> None:
        """Advance the bar."""
        if self._task is not None:
            self._bars.update(self._task, advance=1, now=f"{name}: {outcome(entry)}")


def outcome(entry: Mapping[str, Any]) -> str:
    """Return the result of a run in words."""
    angle, clearance = entry["angle_error_deg"]["max"], entry["min_clearance_m"]
    words = [
        "angle –" if angle is None else f"angle {angle:.3f}°",
        "clearance –" if clearance is None else f"clearance {1000 * clearance:.0f} mm",
        "" if not entry["realtime_factor"] else f"{entry['realtime_factor']:.1f} × real time",
    ]
    return "  ".join(words)
