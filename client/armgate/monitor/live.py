"""Live monitor: a client that checks every state and stops the cell if a rule is violated."""

import signal
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from armgate.client import Cell as Connection
from armgate.client import ClientError, ConnectionLost, Refused, State, TimedOut
from armgate.monitor.description_check import differences, joint_orders
from armgate.monitor.errors import DescriptionError, MonitorError
from armgate.monitor.findings import Finding, Summary
from armgate.monitor.model import build
from armgate.monitor.monitor import Monitor
from armgate.monitor.report import first_line
from armgate.monitor.tick_state import FIELDS, tick_states
from armgate.monitor.yaml_files import read_files

BACKLOG = 2_000
"""Number of states that may wait to be checked; further ones are counted as missed."""

WAIT = 0.1
"""Time to wait for a state before silence is checked, s."""

WAITS_BETWEEN_PINGS = 50
"""Number of waits without a state after which the daemon must answer a ping."""

MEASURED_EVERY = 8
"""The smallest clearances, the most expensive check, are measured at every n-th tick of a robot."""

BETWEEN_STOPS = 1.0
"""Shortest time between two stops of the cell, s."""

LATE = 0.5
"""States that are checked later than this are counted as late, s."""

_DRIFT = 2e-4
"""Relative drift between the clocks of two machines."""

_LONGEST_REASON = 500
Echo = Callable[[str], None]


class LiveMonitor:
    """Connection whose states are checked.

    Args:
        cell: The connection.
        configs: The configuration to check against.
        silence: Time without a state after which a robot counts as silent, s.
        echo: Function that prints a line.
    """

    def __init__(self, cell: Connection, configs: Sequence[Path], silence: float, echo: Echo) -> None:
        self._connection = cell
        self._echo = echo
        self._stop_time = -BETWEEN_STOPS
        self._stop_due: Finding | None = None
        self._stop = 0
        self._stops: dict[str, frozenset[int]] = {}
        self._checked: deque[State] = deque(maxlen=BACKLOG)
        self._age = StateAge()
        self._silence = silence
        self._start, self._unseen_noted = time.monotonic(), False
        model = build(read_files(configs), joint_orders(cell.description))
        self._monitor = Monitor(model, silence, MEASURED_EVERY, lockstep=cell.welcome.lockstep)
        for note in model.notes:
            echo(f"note: {note}")
        echo(first_line(model))
        self._report(self._monitor.add_differences(differences(model, cell.description, self._asset)))

    @property
    def summary(self) -> Summary:
        """Summary of the checks so far."""
        return self._monitor.summary

    def run(self, ended: Callable[[], bool]) -> None:
        """Check states until ``ended`` returns True.

        Raises:
            MonitorError: The connection is lost.
        """
        wall = self._start = time.monotonic()
        cpu = time.process_time()
        try:
            self._connection.subscribe(fields=FIELDS)
            while not ended():
                self._check_states(ended)
        except ClientError as error:
            raise MonitorError(f"the cell is no longer monitored: {error}") from error
        finally:
            self.summary.share = (time.process_time() - cpu) / max(time.monotonic() - wall, 1e-9)

    def _asset(self, name: str) -> bytes:
        """Return the file that the description refers to by this hash; the connection verifies the hash."""
        try:
            return self._connection.asset(name)
        except (Refused, ConnectionLost) as error:
            raise DescriptionError(f"the daemon does not send the described URDF: {error}") from error

    def _check_states(self, ended: Callable[[], bool]) -> None:
        """Check states, and check for silence after each wait without one, until ``ended`` returns True."""
        waits = 0
        states = self._new_states()
        while not ended():
            try:
                state = next(states)
            except TimedOut:
                states = self._new_states()
                waits += 1
                self._check_silence(waits)
            else:
                waits = 0
                self._check(state)
            self._note_unseen()

    def _check_silence(self, waits: int) -> None:
        """Report silent robots, and ping a silent daemon; a stop that is due also serves as a ping."""
        if self._connection.welcome.lockstep:
            return
        self._report(self._monitor.add_silence(waits * WAIT))
        if waits % WAITS_BETWEEN_PINGS == 0 and self._stop_due is None:
            self._connection.ping()

    def _note_unseen(self) -> None:
        """Print the robots that have sent no state, once the silence time has passed since the start."""
        if self._unseen_noted or time.monotonic() - self._start <= self._silence:
            return
        self._unseen_noted = True
        if self.summary.unseen:
            names = ", ".join(self.summary.unseen)
            self._echo(f"note: no state yet of {names}; they are not checked until a state is received")

    def _new_states(self) -> Iterator[State]:
        """Yield new states; the connection begins with kept states, some of which may be checked already."""
        states = self._connection.states(timeout=WAIT, backlog=BACKLOG)
        state = next(states)
        if any(state is one for one in self._checked):
            while state is not self._checked[-1]:
                state = next(states)
            state = next(states)
        while True:
            self._checked.append(state)
            yield state
            state = next(states)

    def _check(self, message: State) -> None:
        own, others = tick_states(message)
        if own is None:
            return
        self._stops |= {state.robot: state.stops for state in (own, *others)}
        if not self._connection.welcome.lockstep and self._age.is_late(own.time, time.monotonic()):
            self.summary.late += 1
            if self._age.first_late:
                seconds = self._age.seconds
                self._echo(f"note: states are checked {seconds:.1f} s late; the machine is too busy")
        self._report(self._monitor.check(own, others))

    def _report(self, found: list[Finding]) -> None:
        """Print findings, and stop the cell: at once, or as soon as the next stop is allowed."""
        for finding in found:
            self._echo(f"violated: {finding}")
        if found and self._stop_due is None:
            self._stop_due = found[0]
        now = time.monotonic()
        if self._stop_due is None or now - self._stop_time < BETWEEN_STOPS:
            return
        self._stop_time = now
        if not (self._stop and all(self._stop in stops for stops in self._stops.values())):
            self._stop_for(self._stop_due)
        else:
            self._stop_due = None  # the stop for the previous finding is still in force

    def _stop_for(self, finding: Finding) -> None:
        """Stop the cell; a stop that is refused or not answered stays due."""
        try:
            self._stop = self._connection.stop(reason=f"monitor: {finding}"[:_LONGEST_REASON]).stop
        except (TimedOut, Refused) as error:
            self._echo(f"the cell could not be stopped, will retry: {error}")
            return
        self._stop_due = None
        self._echo(f"stopped the cell: stop {self._stop}")


class StateAge:
    """Delay from the time of a state to its check, in excess of the least delay observed.

    Attributes:
        seconds: Age of the newest state.
        first_late: True if the newest state is the first late one.
    """

    def __init__(self) -> None:
        self.seconds, self.first_late = 0.0, False
        self._least = self._now = float("inf")

    def is_late(self, time: float, now: float) -> bool:
        """Return True if a state is late, from its daemon time and the time of the check."""
        before = self.seconds > LATE
        drift = _DRIFT * max(0.0, now - self._now)
        self._least, self._now = min(self._least + drift, now - time), now
        self.seconds = now - time - self._least
        self.first_late = self.seconds > LATE and not before
        return self.seconds > LATE


@contextmanager
def end_requests() -> Iterator[Callable[[], bool]]:
    """Yield a function that returns True after SIGINT or SIGTERM; a second signal ends the process."""
    requested = False

    def request(_signum: int, _frame: object) -> None:
        nonlocal requested
        if requested:
            raise KeyboardInterrupt
        requested = True

    before = {signum: signal.signal(signum, request) for signum in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield lambda: requested
    finally:
        for signum, handler in before.items():
            signal.signal(signum, handler)
