"""One run: daemon, leader and follower as processes, watched until the path ends or somebody ends it."""

import re
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from armgate.apps.demo.observation import Observation
from armgate.apps.demo.processes import Asked, Crew, Event, Exited, Printed, armgate
from armgate.apps.errors import AppError
from armgate.client import ClientError, Description, State, connect
from armgate.control.compiled import prepare

DAEMON, LEADER, FOLLOWER = "daemon", "leader", "follower"
CONTROLLERS = (LEADER, FOLLOWER)
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
        path: The leader's recorded path.
        leader: The robot that is led along the path.
        follower: The robot that carries the camera.
        lag: Of the follower's robot behind its setpoint, s.
        lockstep: Whether ticks wait for the controllers instead of the clock.
        duration: How much of the path is played, s; None for all.
        record: The folder that the daemon records into; None for none.
    """

    configs: Sequence[Path]
    path: Path
    leader: str
    follower: str
    lag: float = 0.03
    lockstep: bool = False
    duration: float | None = None
    record: Path | None = None

    def daemon(self) -> list[str]:
        """The command that starts the daemon."""
        recording = [] if self.record is None else ["--record", str(self.record)]
        command = armgate("serve", *map(str, self.configs), "--port", "0", *recording, lockstep=self.lockstep)
        return [*command, "--lockstep", ",".join(CONTROLLERS)] if self.lockstep else command

    def controller(self, name: str, address: str) -> list[str]:
        """The command that starts the leader or the follower."""
        if name == FOLLOWER:
            own = [
                "follow",
                address,
                "--robot",
                self.follower,
                "--leader",
                self.leader,
                "--lag",
                str(self.lag),
            ]
        else:
            own = ["lead", address, "--robot", self.leader, "--path", str(self.path)]
            own += [] if self.duration is None else ["--duration", str(self.duration)]
        return armgate(*own, "--name", name, lockstep=self.lockstep)


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
    crew.start(DAEMON, plan.daemon())
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
        for name in CONTROLLERS:
            crew.start(name, plan.controller(name, address))
        try:
            complete = _until_done(crew, lambda: show(watch))
        finally:
            _rest(crew)
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


def _until_done(crew: Crew, show: Callable[[], None]) -> bool:
    """Watches until both controllers have ended (True) or the user wants to end (False)."""
    due = time.monotonic()
    while crew.running(*CONTROLLERS):
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


def _rest(crew: Crew) -> None:
    """Ends everything in order: controllers slow to rest, then the daemon."""
    crew.send(signal.SIGINT, *CONTROLLERS)
    crew.wait(CONTROLLERS, REST_TIME)
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
