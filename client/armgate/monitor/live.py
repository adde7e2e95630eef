"""Live watch: a client that judges every state and stops the cell."""

import signal
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from armgate.client import Cell as Connection
from armgate.client import ClientError, State, TimedOut
from armgate.monitor.agreement import differences, orders_of
from armgate.monitor.core import Account, Monitor
from armgate.monitor.errors import MonitorError
from armgate.monitor.findings import Finding
from armgate.monitor.model import build
from armgate.monitor.report import beginning
from armgate.monitor.samples import FIELDS, of_state
from armgate.monitor.yaml_files import read_files

BACKLOG = 2_000
"""States that may wait to be judged; more are counted as missed."""

LOOK = 0.1
"""After so long without a state the silence is looked at, s."""

MEASURED_EVERY = 8
"""At one of so many ticks of a robot the smallest clearances are measured: it costs more than all else."""

BETWEEN_STOPS = 1.0
"""A cell is stopped again after this time at the earliest, s."""

_LONGEST = 500
Tell = Callable[[str], None]


class Watch:
    """A connection whose states are judged.

    Args:
        cell: The connection.
        configs: The configuration to judge by.
        silence: A robot without a state for so long is silent, s.
        tell: Prints a line.
    """

    def __init__(self, cell: Connection, configs: Sequence[Path], silence: float, tell: Tell) -> None:
        self._connection = cell
        self._tell = tell
        self._stopped = -BETWEEN_STOPS
        self._last: State | None = None
        model = build(read_files(configs), orders_of(cell.description))
        self._monitor = Monitor(model, silence, MEASURED_EVERY)
        for note in model.notes:
            tell(f"note: {note}")
        tell(beginning(model))
        self._act(self._monitor.differ(differences(model, cell.description)))

    @property
    def account(self) -> Account:
        """What was checked and found so far."""
        return self._monitor.account

    def run(self, ended: Callable[[], bool]) -> None:
        """Judge states until ``ended``.

        Raises:
            MonitorError: The connection is lost.
        """
        wall, cpu = time.monotonic(), time.process_time()
        try:
            self._connection.subscribe(fields=FIELDS)
            while not ended():
                self._listen(ended)
        except ClientError as error:
            raise MonitorError(f"the cell is not watched any more: {error}") from error
        finally:
            self.account.share = (time.process_time() - cpu) / max(time.monotonic() - wall, 1e-9)

    def _listen(self, ended: Callable[[], bool]) -> None:
        """Judge states until none comes for the time of the silence, or ``ended``."""
        waited = 0.0
        while not ended():
            try:
                for state in self._new_states():
                    waited = 0.0
                    self._take(state)
                    if ended():
                        return
            except TimedOut:
                waited += LOOK
                if not self._connection.welcome.lockstep:
                    self._act(self._monitor.silent(waited))

    def _new_states(self) -> Iterator[State]:
        """Yield states; the connection begins with those that it has kept, up to the last one yielded."""
        known = self._last is not None
        for state in self._connection.states(timeout=LOOK, backlog=BACKLOG):
            if known:
                known = state is not self._last
                continue
            self._last = state
            yield state

    def _take(self, state: State) -> None:
        sample, others = of_state(state)
        if sample is not None:
            self._act(self._monitor.take(sample, others))

    def _act(self, found: list[Finding]) -> None:
        """Print findings, and stop the cell."""
        for finding in found:
            self._tell(f"violated: {finding}")
        now = time.monotonic()
        if found and now - self._stopped >= BETWEEN_STOPS:
            stopped = self._connection.stop(reason=f"monitor: {found[0]}"[:_LONGEST])
            self._stopped = now
            self._tell(f"stopped the cell: stop {stopped.stop}")


@contextmanager
def asked_to_end() -> Iterator[Callable[[], bool]]:
    """Turn SIGINT and SIGTERM into a wish to end; a second one ends the process at once."""
    asked = False

    def take(_signum: int, _frame: object) -> None:
        nonlocal asked
        if asked:
            raise KeyboardInterrupt
        asked = True

    before = {signum: signal.signal(signum, take) for signum in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield lambda: asked
    finally:
        for signum, handler in before.items():
            signal.signal(signum, handler)
