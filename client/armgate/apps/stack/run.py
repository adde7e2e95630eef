"""One run: daemon and participants as processes, watched until it is over or somebody ends it."""

import re
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from armgate.apps.errors import AppError
from armgate.apps.stack.observation import Observation
from armgate.apps.stack.processes import Asked, Crew, Event, Exited, Printed
from armgate.client import ClientError, Description, State, connect
from armgate.control.compiled import prepare

DAEMON, LEADER, FOLLOWER = "daemon", "leader", "follower"
LISTENING = re.compile(r"^armgate: listening on (\S+)$")
START_TIME = 60.0
"""How long the daemon may take to listen, s."""
REST_TIME = 15.0
"""How long processes may take to bring their robots to rest and end, s."""
BACKLOG = 10_000
"""How many states may wait to be taken in: no extremum shall be lost to a busy moment."""
REFRESH = 0.1
"""Time between two pictures, s."""


@dataclass(frozen=True)
class Plan:
    """What is run.

    Attributes:
        configs: Configuration files of the daemon, later ones overlay earlier ones.
        follower: The robot that carries the camera, whose ticks are watched.
        controllers: Participants by name, each an ``armgate`` command without the daemon's address and the
            name.
        lockstep: Whether ticks wait for the controllers instead of the clock.
        until: Whose end ends the run; all of them if none is named.
        record: The folder that the daemon records into; None for none.
    """

    configs: Sequence[Path]
    follower: str
    controllers: Mapping[str, Sequence[str]]
    lockstep: bool = False
    until: tuple[str, ...] = ()
    record: Path | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """The participants, in order."""
        return tuple(self.controllers)

    def daemon(self) -> list[str]:
        """What starts the daemon, after ``armgate``."""
        recording = [] if self.record is None else ["--record", str(self.record)]
        command = ["serve", *map(str, self.configs), "--port", "0", *recording]
        return [*command, "--lockstep", ",".join(self.names)] if self.lockstep else command

    def controller(self, name: str, address: str) -> list[str]:
        """What starts a participant, after ``armgate``."""
        command, *options = self.controllers[name]
        return [command, address, *options, "--name", name]


@dataclass
class Watch:
    """An observer's connection, read in a thread of its own so that no picture delays a state."""

    seen: Observation
    cell: Description
    started: float = 0.0
    latest: float = 0.0
    error: ClientError | None = None
    lock: threading.Lock = field(default_factory=threading.Lock)

    def follow(self, states: Iterator[State]) -> None:
        """Takes every state until the connection ends."""
        try:
            for state in states:
                with self.lock:
                    self.seen.take(state)
                    self.latest = time.monotonic()
                    self.started = self.started or self.latest
        except ClientError as error:
            self.error = error

    @property
    def wall(self) -> float:
        """Time by the clock from the first state to the newest, s."""
        return self.latest - self.started

    @property
    def factor(self) -> float | None:
        """How much faster than the clock the run went so far."""
        return self.seen.elapsed / self.wall if self.wall > 0.5 else None


def run(crew: Crew, plan: Plan, show: Callable[[Watch], None]) -> tuple[Watch, bool]:
    """Runs the plan and shows it about ten times a second.

    Returns:
        What was watched, and whether the path was run to its end (it was not if the user stopped it).

    Raises:
        AppError: A process died or never became ready; the text says which, with its last log lines.
    """
    crew.launch(DAEMON, plan.daemon(), lockstep=plan.lockstep)
    # The first run after an installation compiles the law: here, and not while the leader is on its way.
    prepare()
    address = _listening(crew)
    if address is None:
        raise AppError("interrupted before the daemon was ready")
    with connect(address, name="demo", role="observer") as cell:
        watch = Watch(Observation(plan.follower), cell.description)
        # A state holds an entry of every robot; those at the follower's ticks hold its newest errors, too.
        cell.subscribe(every=1, robots=[plan.follower])
        reader = threading.Thread(
            target=watch.follow, args=(cell.states(backlog=BACKLOG),), name="states", daemon=True
        )
        reader.start()
        for name in plan.names:
            crew.launch(name, plan.controller(name, address), lockstep=plan.lockstep)
        try:
            complete = _until_done(crew, plan.until or plan.names, lambda: show(watch))
        finally:
            _rest(crew, plan.names)
        reader.join(REST_TIME)
    return watch, complete


def _listening(crew: Crew) -> str | None:
    """The daemon's address once it listens; None if the user stopped the run before."""
    deadline = time.monotonic() + START_TIME
    while (left := deadline - time.monotonic()) > 0.0:
        event = crew.next(left)
        if isinstance(event, Printed) and (match := LISTENING.match(event.text)):
            return match[1]
        if isinstance(event, Asked):
            return None
        if isinstance(event, Exited):
            raise died(crew, event)
    raise AppError(f"the daemon did not listen within {START_TIME:g} s; see {crew.log(DAEMON)}")


def _until_done(crew: Crew, names: Sequence[str], show: Callable[[], None]) -> bool:
    """Watches until the named have ended (True) or the user wants to end (False)."""
    due = time.monotonic()
    while crew.running(*names):
        now = time.monotonic()
        if now >= due:
            show()
            due = now + REFRESH
        if not _goes_on(crew, crew.next(max(0.0, due - time.monotonic()))):
            return False
    while (event := crew.next(0.0)) is not None:
        if not _goes_on(crew, event):
            return False
    show()
    return True


def _goes_on(crew: Crew, event: Event | None) -> bool:
    if isinstance(event, Exited) and (event.status != 0 or event.name == DAEMON):
        raise died(crew, event)
    return not isinstance(event, Asked)


def _rest(crew: Crew, names: Sequence[str]) -> None:
    """Ends everything in order: participants slow to rest, then the daemon."""
    crew.send(signal.SIGINT, *names)
    crew.wait(names, REST_TIME)
    crew.send(signal.SIGTERM, DAEMON)
    crew.wait([DAEMON], REST_TIME)


def died(crew: Crew, event: Exited) -> AppError:
    """What to say of a process that ended by itself: which, how, and the last lines of its log."""
    how = (
        f"was killed by {signal.Signals(-event.status).name}"
        if event.status < 0
        else f"ended ({event.status})"
    )
    tail = "\n".join(f"  | {text}" for text in crew.tail(event.name))
    return AppError(f"the {event.name} {how}; its log {crew.log(event.name)} ends with\n{tail}")


@contextmanager
def interruptions(crew: Crew) -> Iterator[None]:
    """Turns the signals that ask this process to end into events; the second one ends it at once."""
    asked = False

    def take(signum: int, _frame: object) -> None:
        nonlocal asked
        if asked:
            raise KeyboardInterrupt
        asked = True
        crew.events.put(Asked(signum))

    wanted = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = {signum: signal.signal(signum, take) for signum in wanted}
    try:
        yield
    finally:
        for signum, handler in before.items():
            signal.signal(signum, handler)
