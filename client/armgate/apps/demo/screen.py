"""Where a run is shown: a live picture in a terminal, a line a second anywhere else."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rich.console import Console, RenderableType
from rich.live import Live

from armgate.apps.demo.display import line, picture

if TYPE_CHECKING:
    from armgate.apps.stack.run import Watch

LINE_EVERY = 1.0
"""Daemon time between two plain lines, s; in lock-step they come as much faster as the run is."""


@contextmanager
def screen(terminal: bool, console: Console | None = None) -> Iterator[Callable[["Watch"], None]]:
    """A function that shows the run as it is now; whoever watches calls it as often as it shall be fresh."""
    console = console or Console(highlight=False)
    if not terminal:
        yield Lines(console).show
        return
    with Live(console=console, auto_refresh=False, transient=False) as live:
        yield lambda watch: live.update(_picture(watch), refresh=True)


def _picture(watch: "Watch") -> RenderableType:
    with watch.lock:
        return picture(watch.seen, watch.cell, watch.factor)


class Lines:
    """Prints a line whenever a second of daemon time has passed."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._due = 0.0

    def show(self, watch: "Watch") -> None:
        """Prints the run's line if one is due."""
        with watch.lock:
            if watch.seen.state is None or watch.seen.elapsed < self._due:
                return
            self._due = watch.seen.elapsed + LINE_EVERY
            text = line(watch.seen)
        self._console.print(text, soft_wrap=True, markup=False)
