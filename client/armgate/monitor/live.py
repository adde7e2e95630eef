"""Live watch: a client that judges every state and stops the cell."""

import signal
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from armgate.client import Cell as Connection
from armgate.client import ClientError, ConnectionLost, Refused, State, TimedOut
from armgate.monitor.agreement import differences, orders_of
from armgate.monitor.core import Account, Monitor
from armgate.monitor.errors import DescriptionError, MonitorError
from armgate.monitor.findings import Finding
from armgate.monitor.model import build
from armgate.monitor.report import beginning
from armgate.monitor.samples import FIELDS, of_state
from armgate.monitor.yaml_files import read_files

BACKLOG = 2_000
"""States that may wait to be judged; more are counted as missed."""

LOOK = 0.1
"""After so long without a state the silence is looked at, s."""

LOOKS_BETWEEN_PINGS = 50
"""After so many looks without a state the daemon must answer a ping."""

MEASURED_EVERY = 8
"""At one of so many ticks of a robot the smallest clearances are measured: it costs more than all else."""

BETWEEN_STOPS = 1.0
"""A cell is stopped again after this time at the earliest, s."""

LATE = 0.5
"""States that are judged later than this are noted, s."""

_DRIFT = 2e-4
"""Clocks of two machines may drift apart by this share."""

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
        self._asked = -BETWEEN_STOPS
        self._due: Finding | None = None
        self._stop = 0
        self._stops: dict[str, frozenset[int]] = {}
        self._judged: deque[State] = deque(maxlen=BACKLOG)
        self._age = Age()
        self._silence_time = silence
        self._begun, self._noted = time.monotonic(), False
        model = build(read_files(configs), orders_of(cell.description))
        self._monitor = Monitor(model, silence, MEASURED_EVERY, lockstep=cell.welcome.lockstep)
        for note in model.notes:
            tell(f"note: {note}")
        tell(beginning(model))
        self._act(self._monitor.differ(differences(model, cell.description, self._asset)))

    @property
    def account(self) -> Account:
        """What was checked and found so far."""
        return self._monitor.account

    def run(self, ended: Callable[[], bool]) -> None:
        """Judge states until ``ended``.

        Raises:
            MonitorError: The connection is lost.
        """
        wall = self._begun = time.monotonic()
        cpu = time.process_time()
        try:
            self._connection.subscribe(fields=FIELDS)
            while not ended():
                self._listen(ended)
        except ClientError as error:
            raise MonitorError(f"the cell is not watched any more: {error}") from error
        finally:
            self.account.share = (time.process_time() - cpu) / max(time.monotonic() - wall, 1e-9)

    def _asset(self, name: str) -> bytes:
        """Return what the description names by its hash; the connection checks it against the hash."""
        try:
            return self._connection.asset(name)
        except (Refused, ConnectionLost) as error:
            raise DescriptionError(f"the daemon does not send the described URDF: {error}") from error

    def _listen(self, ended: Callable[[], bool]) -> None:
        """Judge states, and look after each time without one, until ``ended``."""
        looks = 0
        states = self._new_states()
        while not ended():
            try:
                state = next(states)
            except TimedOut:
                states = self._new_states()
                looks += 1
                self._silence(looks)
            else:
                looks = 0
                self._take(state)
            self._note_unseen()

    def _silence(self, looks: int) -> None:
        """Act on the silence of robots, or of the daemon: a stop that is due is a ping, too."""
        if self._connection.welcome.lockstep:
            return
        self._act(self._monitor.silent(looks * LOOK))
        if looks % LOOKS_BETWEEN_PINGS == 0 and self._due is None:
            self._connection.ping()

    def _note_unseen(self) -> None:
        """Print once of which robots no state came for the time of the silence."""
        if self._noted or time.monotonic() - self._begun <= self._silence_time:
            return
        self._noted = True
        if self.account.unseen:
            names = ", ".join(self.account.unseen)
            self._tell(f"note: no state yet of {names}; nothing of them is checked until they tick")

    def _new_states(self) -> Iterator[State]:
        """Yield states; the connection begins with those that it has kept, of which some were judged."""
        states = self._connection.states(timeout=LOOK, backlog=BACKLOG)
        state = next(states)
        if any(state is one for one in self._judged):
            while state is not self._judged[-1]:
                state = next(states)
            state = next(states)
        while True:
            self._judged.append(state)
            yield state
            state = next(states)

    def _take(self, state: State) -> None:
        sample, others = of_state(state)
        if sample is None:
            return
        self._stops |= {one.robot: one.stops for one in (sample, *others)}
        if not self._connection.welcome.lockstep and self._age.take(sample.time, time.monotonic()):
            self.account.late += 1
            if self._age.rises:
                self._tell(f"note: states are judged {self._age.seconds:.1f} s late; the machine is too busy")
        self._act(self._monitor.take(sample, others))

    def _act(self, found: list[Finding]) -> None:
        """Print findings, and stop the cell: at once, or as soon as it may be stopped again."""
        for finding in found:
            self._tell(f"violated: {finding}")
        if found and self._due is None:
            self._due = found[0]
        now = time.monotonic()
        if self._due is None or now - self._asked < BETWEEN_STOPS:
            return
        self._asked = now
        if not (self._stop and all(self._stop in stops for stops in self._stops.values())):
            self._stop_for(self._due)
        else:
            self._due = None  # the stop for the finding before is still in force

    def _stop_for(self, finding: Finding) -> None:
        """Stop the cell; a stop that was not answered or is refused stays due."""
        try:
            self._stop = self._connection.stop(reason=f"monitor: {finding}"[:_LONGEST]).stop
        except (TimedOut, Refused) as error:
            self._tell(f"the cell could not be stopped, to be repeated: {error}")
            return
        self._due = None
        self._tell(f"stopped the cell: stop {self._stop}")


class Age:
    """How late states are judged, by the least delay between the clocks of daemon and monitor.

    Attributes:
        seconds: Age of the newest state.
        rises: True if it is the first late one.
    """

    def __init__(self) -> None:
        self.seconds, self.rises = 0.0, False
        self._least = self._now = float("inf")

    def take(self, time: float, now: float) -> bool:
        """Take a state's daemon time and the time at which it is judged; return True if that is late."""
        before = self.seconds > LATE
        drift = _DRIFT * max(0.0, now - self._now)
        self._least, self._now = min(self._least + drift, now - time), now
        self.seconds = now - time - self._least
        self.rises = self.seconds > LATE and not before
        return self.seconds > LATE


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
