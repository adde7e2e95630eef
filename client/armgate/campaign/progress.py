"""Progress of a campaign: a bar in a terminal, otherwise a line every few seconds."""

import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Protocol

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TaskID, TextColumn, TimeElapsedColumn
from rich.progress import Progress as Bars

LINE_TIME = 10.0
"""Time between two lines, s."""
WINDOW = 30.0
"""Time over which the rate is measured, s."""


class Progress(Protocol):
    """Display of the progress of a campaign."""

    def done(self, failed: bool) -> None:
        """Show one more result."""


@contextmanager
def progress(total: int, stored: int, console: Console | None = None) -> Iterator[Progress]:
    """Yield a bar in a terminal, otherwise lines.

    Args:
        total: Number of trials of the campaign.
        stored: Number of results from earlier runs.
        console: Terminal or file; None: standard output.
    """
    console = console or Console(highlight=False)
    if not console.is_terminal:
        lines = Lines(console, Counter(total, stored))
        yield lines
        lines.end()
        return
    columns = (
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.fields[now]}", style="dim"),
    )
    with Bars(*columns, console=console) as bars:
        yield InTerminal(bars, Counter(total, stored))


class Counter:
    """Numbers of results, and the rate of the last half minute.

    Args:
        total: Number of trials.
        stored: Number of results from earlier runs.
        clock: Time, s.
    """

    def __init__(self, total: int, stored: int, clock: Callable[[], float] = time.monotonic) -> None:
        self.total, self.done, self.failed = total, stored, 0
        self._clock = clock
        self._times = deque([clock()])

    def count(self, failed: bool) -> None:
        """Add a result."""
        self.done += 1
        self.failed += failed
        now = self._clock()
        self._times.append(now)
        while self._times[0] < now - WINDOW:
            self._times.popleft()

    @property
    def text(self) -> str:
        """Rate, estimate and failures in words."""
        span = self._times[-1] - self._times[0]
        rate = (len(self._times) - 1) / span if span > 0.0 else 0.0
        words = []
        if rate > 0.0:
            words.append(f"{rate:.3g} trials/s")
            if self.done < self.total:
                words.append(f"{duration((self.total - self.done) / rate)} left")
        if self.failed:
            words.append(f"{self.failed} failed")
        return ", ".join(words)


class Lines:
    """Display with a line every few seconds."""

    def __init__(
        self, console: Console, counter: Counter, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._console, self._counter, self._clock = console, counter, clock
        self._printed = -1
        self._due = clock() + LINE_TIME

    def done(self, failed: bool) -> None:
        """Count a result; print a line if one is due."""
        self._counter.count(failed)
        if self._clock() >= self._due:
            self._print()

    def end(self) -> None:
        """Print the last line."""
        if self._counter.done != self._printed:
            self._print()

    def _print(self) -> None:
        counter = self._counter
        text = f"{counter.done}/{counter.total}  {counter.text}".rstrip()
        self._console.print(text, soft_wrap=True)
        self._printed, self._due = counter.done, self._clock() + LINE_TIME


class InTerminal:
    """Display with a bar."""

    def __init__(self, bars: Bars, counter: Counter) -> None:
        self._bars, self._counter = bars, counter
        self._task: TaskID = bars.add_task("", total=counter.total, completed=counter.done, now="")

    def done(self, failed: bool) -> None:
        """Advance the bar."""
        self._counter.count(failed)
        self._bars.update(self._task, advance=1, now=self._counter.text)


def duration(seconds: float) -> str:
    """Return a duration in words of two units at most."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    if hours:
        return f"{hours} h {minutes:02} min"
    return f"{minutes} min {rest:02} s" if minutes else f"{rest} s"
