"""One run: start daemon and participants as processes, watch them to the end, then end all in order."""

import re
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import assert_never

import typer

from armgate.apps.errors import AppError
from armgate.apps.stack.child import INTERRUPTED
from armgate.apps.stack.failures import exit_error, failure_of, stops_in
from armgate.apps.stack.monitoring import (
    MONITOR,
    WATCHING,
    audit,
    monitor_command,
    remove_report,
    violation_error,
)
from armgate.apps.stack.observation import Observation, completed
from armgate.apps.stack.plan import DAEMON, ORDINARY, VIEWER, Plan
from armgate.apps.stack.processes import Children, Event, Exited, Interrupted, Printed
from armgate.apps.stack.robot_processes import SERVER, RobotProcesses
from armgate.cell.compilation import announced
from armgate.cell.terminal_text import printable
from armgate.client import ClientError, Description, State, connect
from armgate.control.compiled import prepare

NEEDED = frozenset({DAEMON, SERVER, MONITOR})
"""Children that must run until the end of any run."""
LISTENING = re.compile(r"^armgate: listening on (\S+)$")
HOLDING = re.compile(r"^armgate: robot server at (.+)$")
VIEW_OPTIONS = ("--role", "operator", "--port", "0", "--open")
START_TIME = 60.0
"""Timeout for a started process, or for all robots, to be ready, s."""
_LOOK = 0.02
"""Period of checks for which there is no event, s."""
_ASKED = (0, INTERRUPTED, -signal.SIGINT)
"""Exit statuses of children that were requested to end; the last one occurs while libraries are loading."""
REST_TIME = 15.0
"""Timeout for processes to bring their robots to rest and end, s."""
BACKLOG = 10_000
"""Number of states that may be queued, so that a busy moment loses no extremum."""
REFRESH = 0.1
"""Period of the display, s."""
_SHOWN_EVERY = 5
"""In lock-step with a recording, every state of this number is observed: the recording has them all."""


@dataclass
class Span:
    """Time in the cell and wall-clock time since the second state.

    In lock-step the first state waits for the participants, so its wall-clock time is part of their start.
    """

    first: tuple[float, float] | None = None
    newest: tuple[float, float] = (0.0, 0.0)

    def note(self, elapsed: float, wall: float) -> None:
        """Note a state, at a time in the cell since the first state and at a wall-clock time, s."""
        self.newest = (elapsed, wall)
        if self.first is None and elapsed > 0.0:
            self.first = self.newest

    @property
    def wall(self) -> float:
        """Wall-clock time, s."""
        return 0.0 if self.first is None else self.newest[1] - self.first[1]

    @property
    def factor(self) -> float | None:
        """Time in the cell as a multiple of wall-clock time; None before the third state."""
        return (self.newest[0] - self.first[0]) / self.wall if self.first is not None and self.wall else None


@dataclass
class Watch:
    """Connection of an observer, read in a thread of its own so that drawing delays no state."""

    seen: Observation
    cell: Description
    span: Span = field(default_factory=Span)
    error: ClientError | None = None
    lock: threading.Lock = field(default_factory=threading.Lock)

    def follow(self, states: Iterator[State]) -> None:
        """Observe every state until the connection ends."""
        try:
            for state in states:
                with self.lock:
                    self.seen.take(state)
                    self.span.note(self.seen.elapsed, time.monotonic())
        except ClientError as error:
            self.error = error

    def complete(self, recording: Path, lockstep: bool) -> None:
        """Use the observation from the recording if states were missed, and always in lock-step."""
        with self.lock:
            self.seen = completed(self.seen, recording, lockstep)

    @property
    def wall(self) -> float:
        """Wall-clock time of the observed run, s."""
        factor = self.span.factor
        return self.seen.elapsed / factor if factor else 0.0

    @property
    def factor(self) -> float | None:
        """Speed of the run so far, as a multiple of real time."""
        return self.span.factor if self.span.wall > 0.5 else None


@dataclass(frozen=True)
class Ended:
    """End of a run.

    Attributes:
        watch: Connection of the observer, with its observation.
        complete: True if all participants finished their work, and no audit was interrupted.
        failure: First failure after the participants were started; None without one.
    """

    watch: Watch
    complete: bool
    failure: AppError | None = None


def run(children: Children, plan: Plan, show: Callable[[Watch], None]) -> Ended:
    """Run the plan; show it about ten times a second, and print the output of a viewer.

    Raises:
        AppError: A process failed or was not ready before the participants were started; the text names it
            and contains its last log lines. Later failures are in the result, with the observation until
            then.
    """
    address = _start_daemon(children, plan)
    if plan.record is not None:
        remove_report(plan.record)
    with connect(address, name="demo", role="observer") as cell:
        watch = Watch(Observation(plan.follower, until_released=bool(plan.until)), cell.description)
        # A state holds an entry of every robot; states at the follower's ticks also hold its newest errors.
        recorded = plan.lockstep and plan.record is not None
        cell.subscribe(every=_SHOWN_EVERY if recorded else 1, robots=[plan.follower])
        reader = threading.Thread(
            target=watch.follow, args=(cell.states(backlog=BACKLOG),), name="states", daemon=True
        )
        reader.start()
        _until_ready(children, watch, _needed(plan))
        _start_clients(children, plan, address)
        complete, failure = _watched(children, plan, watch, show)
        reader.join(REST_TIME)
    if plan.record is not None:
        watch.complete(plan.record, plan.lockstep)
    if plan.monitor and plan.lockstep and plan.record is not None and complete:
        complete, failure = audit(children, plan.record)
    return Ended(watch, complete and failure is None, failure)


def _start_daemon(children: Children, plan: Plan) -> str:
    """Start the robots' processes and the daemon; return the daemon's address."""
    if plan.robots is not None:
        _start_robots(children, plan, plan.robots)
    children.launch(DAEMON, plan.daemon(), priority=plan.priority("daemon"))
    # The first run after an installation compiles the control law: now, and not while the leader is moving.
    with announced():
        prepare()
    return _printed(children, DAEMON, LISTENING)


def _start_robots(children: Children, plan: Plan, robots: RobotProcesses) -> None:
    """Start the robot server, which must listen before virtual robots send, then the virtual robots."""
    priority = plan.priority("robots")
    children.launch(SERVER, robots.server(plan.configs), priority=priority)
    _printed(children, SERVER, HOLDING)
    for name, command in robots.virtual.items():
        children.launch(name, command, priority=priority)


def _start_clients(children: Children, plan: Plan, address: str) -> None:
    """Start the live monitor, the viewer and the participants."""
    if plan.monitor and not plan.lockstep:
        command = monitor_command(address, plan.configs, plan.record)
        children.launch(MONITOR, command, priority=plan.priority("monitor"))
        _printed(children, MONITOR, WATCHING)
    if plan.view:
        # The viewer is an ordinary process, because it must not delay the robots' processes.
        children.launch(VIEWER, ["view", address, *VIEW_OPTIONS], priority=ORDINARY)
    for name in plan.names:
        children.launch(name, plan.controller(name, address), priority=plan.priority("controller"))


def _watched(
    children: Children, plan: Plan, watch: Watch, show: Callable[[Watch], None]
) -> tuple[bool, AppError | None]:
    """Watch to the end of the run, then end all processes.

    Returns:
        True if all work was finished, and the first failure.
    """
    complete, failure = False, None
    try:
        complete = _until_done(children, plan.until or plan.names, lambda: show(watch), _needed(plan))
        if complete and watch.error is not None:
            failure = AppError(f"the run was not observed to its end: {watch.error}")
    except AppError as error:
        failure = AppError(f"{error}{stops_in(children.log(DAEMON))}")
    finally:
        failure = _rest(children, plan, failure)
    return complete and failure is None, failure


def _printed(children: Children, name: str, what: re.Pattern[str]) -> str:
    """Return the text that a child prints when it is ready."""
    deadline = time.monotonic() + START_TIME
    while (left := deadline - time.monotonic()) > 0.0:
        event = children.next(left)
        if isinstance(event, Printed) and event.name == name and (match := what.match(event.text)):
            return match[1]
        if isinstance(event, Interrupted):
            raise AppError(f"interrupted before the {name} was ready")
        if isinstance(event, Exited):
            raise exit_error(children, event)
    raise AppError(f"the {name} was not ready within {START_TIME:g} s; see {children.log(name)}")


def _until_ready(children: Children, watch: Watch, needed: frozenset[str]) -> None:
    """Wait until all robots can be moved: real and virtual robots take some time."""
    deadline = time.monotonic() + START_TIME
    while time.monotonic() < deadline:
        with watch.lock:
            entries = watch.seen.entries
        if entries and all(entry.link == "ready" and entry.q for entry in entries):
            return
        if not _goes_on(children, children.next(_LOOK), needed):
            raise AppError("interrupted before the robots were ready")
    raise AppError(f"not all robots were ready within {START_TIME:g} s; see {children.log(SERVER)}")


def _until_done(
    children: Children,
    names: Sequence[str],
    show: Callable[[], None],
    needed: frozenset[str] = NEEDED,
) -> bool:
    """Watch until the named children have ended (True) or the user ends the run (False).

    Raises:
        AppError: A child failed, was stopped, or ended although the run still needs it.
    """
    due = time.monotonic()
    while children.running(*names):
        now = time.monotonic()
        if now >= due:
            show()
            due = now + REFRESH
        if not _goes_on(children, children.next(max(0.0, due - time.monotonic())), needed):
            return False
    # An end is queued before its child counts as ended, so the queue holds every failure so far.
    while (event := children.next(0.0)) is not None:
        if not _goes_on(children, event, needed):
            return False
    show()
    return True


def _goes_on(children: Children, event: Event | None, needed: frozenset[str] = NEEDED) -> bool:
    """Return True if the run continues after an event, False if the user ends it.

    Raises:
        AppError: The event is a violation, or the end of a child that failed or is still needed.
    """
    match event:
        case None:
            return True
        case Interrupted():
            return False
        case Printed(name=name) | Exited(name=name) if name == VIEWER:
            _report_viewer(children, event)
        case Printed():
            if (error := violation_error(event)) is not None:
                raise error
        case Exited():
            if event.status != 0 or event.name in needed:
                raise failure_of(children, event)
        case _:
            assert_never(event)
    return True


def _needed(plan: Plan) -> frozenset[str]:
    """Return the children that must run until the end of the run."""
    return NEEDED if plan.robots is None else NEEDED | plan.robots.virtual.keys()


def _report_viewer(children: Children, event: Printed | Exited) -> None:
    """Print the viewer's output; a run continues without its viewer."""
    if isinstance(event, Printed):
        typer.echo(printable(event.text))
    elif event.status != 0:
        typer.echo(f"the run continues without a viewer: {printable(' '.join(children.tail(VIEWER)[-1:]))}")


def _rest(children: Children, plan: Plan, failure: AppError | None) -> AppError | None:
    """End all processes in order: participants, monitor, viewer, daemon, virtual robots, robot server.

    Returns:
        Failure of the run: the given one, or that of the first child that ended with an error.
    """
    children.send(signal.SIGINT, *plan.names)
    children.wait(plan.names, REST_TIME)
    for name in (MONITOR, VIEWER, DAEMON, *(() if plan.robots is None else (*plan.robots.virtual, SERVER))):
        children.send(signal.SIGTERM, name)
        children.wait([name], REST_TIME)
    while (event := children.next(0.0)) is not None:
        if failure is None and isinstance(event, Printed):
            failure = violation_error(event)
        if failure is None and isinstance(event, Exited) and event.name != VIEWER:
            failure = exit_error(children, event) if event.status not in _ASKED else None
    left = [name for name in children.running() if name != VIEWER]
    return failure or (AppError(f"not ended within {REST_TIME:g} s: {', '.join(left)}") if left else None)


@contextmanager
def interruptions(children: Children) -> Iterator[None]:
    """Turn SIGINT, SIGTERM and SIGHUP into events; a second signal ends the process at once.

    SIGHUP stays ignored if the parent ignores it (nohup).
    """
    asked = False

    def take(signum: int, _frame: object) -> None:
        nonlocal asked
        if asked:
            raise KeyboardInterrupt
        asked = True
        children.events.put(Interrupted(signum))

    wanted = [signal.SIGINT, signal.SIGTERM]
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        wanted.append(signal.SIGHUP)
    before = {signum: signal.signal(signum, take) for signum in wanted}
    try:
        yield
    finally:
        for signum, handler in before.items():
            signal.signal(signum, handler)
