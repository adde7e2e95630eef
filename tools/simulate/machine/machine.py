"""Simulated machine: its time, its processes, and the events that they wait for.

Each process has an event loop of its own. One thread runs the turns of all loops, one after the other: always
the turn that is due first, in random order if several are. Time passes only between turns.
"""

import asyncio
import contextlib
import hashlib
import heapq
import random
import sys
from collections import deque
from collections.abc import Callable, Coroutine, Iterator
from typing import Any

from tools.simulate.machine.loop import NEVER, SimulatedLoop

_EPOCH = 1_700_000_000_000_000_000
_TURN_NS = (5_000, 60_000)
"""Shortest and longest time of a turn of an event loop, ns."""

_KEPT = 400
"""Number of the newest trace lines that are kept."""


class Process:
    """Simulated process: an event loop that runs one coroutine.

    Attributes:
        name: Name for the trace.
        loop: Its event loop.
        host: Address of its machine in the network.
        stalled_until: End of its last pause, or of a time in which its turns take long, ns.
        alive: True until it ends or is killed.
        result: Result of the coroutine; None if it was killed or has failed.
        error: Exception of the coroutine.
        leaked: Tasks that were not done when the coroutine ended.
    """

    def __init__(self, machine: "Machine", name: str, host: str) -> None:
        self.name, self.host, self.machine = name, host, machine
        self.loop = SimulatedLoop(self)
        self.alive = True
        self.busy_until = self.stalled_until = self._slow_until = self._slow_ns = 0
        self.sockets: dict[int, Any] = {}
        self.result: Any = None
        self.error: BaseException | None = None
        self.leaked: list[str] = []
        self.on_exit: Callable[[Process], None] = lambda _: None
        self._main: asyncio.Task[Any] | None = None
        self._over = False
        self.next_wake: int | None = None

    def start(self, main: Coroutine[Any, Any, Any]) -> None:
        """Run a coroutine; the process ends with it."""
        with self.machine.inside(self):
            self._main = self.loop.create_task(main)
            self._main.add_done_callback(self._ended)

    def wake(self) -> int:
        """Return the time of its next turn, ns."""
        if self.next_wake is None:
            self.next_wake = max(self.loop.wake(), self.busy_until) if self.alive else NEVER
        return self.next_wake

    def poke(self) -> None:
        """Let the process poll: one of its files may be ready."""
        self.loop.selector.changed = True
        self.next_wake = None

    def pause(self, ns: int) -> None:
        """Let the process do nothing for some time, like one that is swapped out."""
        self.busy_until = max(self.busy_until, self.machine.now) + ns
        self.stalled_until = self.busy_until
        self.next_wake = None

    def slow(self, ns: int, turn_ns: int) -> None:
        """Let turns take up to ``turn_ns`` longer for some time, as on a machine that is overloaded."""
        self._slow_ns, self._slow_until = turn_ns, self.machine.now + ns
        self.stalled_until = max(self.stalled_until, self._slow_until)

    @property
    def delay_ns(self) -> int:
        """Longest additional time of a turn, ns."""
        return self._slow_ns if self.machine.now < self._slow_until else 0

    def signal(self, number: int) -> None:
        """Send a signal; without a handler it kills the process."""
        handler = self.loop.signals.get(number)
        if handler is None:
            self.kill()
        elif self.alive:
            callback, arguments = handler
            self.loop.call_soon(callback, *arguments)
            self.next_wake = None

    def kill(self) -> None:
        """End the process at once: none of its code runs any more, and its sockets are closed."""
        if self.alive:
            self.alive, self.next_wake = False, None
            self.machine.bury(self)
            for sock in tuple(self.sockets.values()):
                sock.close()

    def _ended(self, task: "asyncio.Task[Any]") -> None:
        if task.cancelled():
            self.error = asyncio.CancelledError()
        else:
            self.error = task.exception()
            self.result = None if self.error is not None else task.result()
        self.leaked = [repr(other) for other in self.loop.tasks if other is not task and not other.done()]
        self._over = True

    def exit_if_over(self) -> None:
        """End the process if its coroutine has ended; called after each turn."""
        if self._over and self.alive:
            self.machine.trace("exit", self.name, repr(self.error), repr(self.result))
            self.kill()
            self.on_exit(self)


class Machine:
    """Simulated machine.

    Args:
        seed: Seed of the times of turns and of random numbers.
        keep: True to keep the whole trace.

    Attributes:
        now: Time, ns.
        processes: Processes that are alive.
        turns: Number of turns so far.
        problems: Exceptions that no code has handled.
        day_ns: Time of day at the time 0 of the machine, ns; a step of the clock changes it.
    """

    def __init__(self, seed: str, *, keep: bool = False) -> None:
        self._random = random.Random(f"machine {seed}")  # noqa: S311 (no secret)
        self.now = 1_000_000_000 * self._random.randint(10, 10_000)
        self.processes: list[Process] = []
        self.current: Process | None = None
        self.turns, self.day_ns = 0, _EPOCH
        self.problems: list[str] = []
        self.lines: deque[str] = deque(maxlen=None if keep else _KEPT)
        self._events: list[tuple[int, int, Callable[[], None]]] = []
        self._count = self._used = 0
        self._call_ns = 1_000
        self._hash = hashlib.sha256()
        self._graves: list[Any] = []

    # --- for the standard library ---------------------------------------------------------------------------

    def monotonic_ns(self) -> int:
        """Return the time of the machine, ns."""
        return self.now

    def epoch_ns(self) -> int:
        """Return the time of day, ns since 1970."""
        return self.day_ns + self.now

    def processor_ns(self) -> int:
        """Return the used processor time, ns; every call uses some, in some turns much."""
        self._used += self._call_ns
        return self._used

    def random_bytes(self, count: int) -> bytes:
        """Return random bytes."""
        return self._random.randbytes(count)

    # --- trace ----------------------------------------------------------------------------------------------

    def trace(self, *fields: object) -> None:
        """Add a line to the trace."""
        line = f"{self.now} {' '.join(map(str, fields))}"
        self.lines.append(line)
        self._hash.update(line.encode())

    @property
    def digest(self) -> str:
        """Hash of the trace so far."""
        return self._hash.hexdigest()

    # --- running --------------------------------------------------------------------------------------------

    def at(self, ns: int, event: Callable[[], None]) -> None:
        """Call a function at a time; events of one time happen in the order of these calls."""
        self._count += 1
        heapq.heappush(self._events, (max(ns, self.now), self._count, event))

    def after(self, ns: int, event: Callable[[], None]) -> None:
        """Call a function after some time."""
        self.at(self.now + ns, event)

    def process(self, name: str, host: str = "127.0.0.1") -> Process:
        """Return a new process."""
        made = Process(self, name, host)
        self.processes.append(made)
        return made

    def run(self, until: int, done: Callable[[], bool] = lambda: False) -> None:
        """Run until a time, or until ``done`` returns True."""
        hooks = sys.get_asyncgen_hooks()
        try:
            self._run(until, done)
        finally:
            sys.set_asyncgen_hooks(*hooks)

    def _run(self, until: int, done: Callable[[], bool]) -> None:
        while not done():
            due = self._events[0][0] if self._events else NEVER
            ready = self._ready(due)
            if ready is None and due > until:
                self.now = max(self.now, until)
                return
            if ready is None:
                self.now, _, event = heapq.heappop(self._events)
                event()
            elif ready.wake() > until:
                self.now = max(self.now, until)
                return
            else:
                self._turn(ready)

    def bury(self, process: Process) -> None:
        """Forget a process, but keep its objects: none of its code may run when they are collected."""
        self.processes.remove(process)
        self._graves.append((process, list(process.loop.tasks), list(process.loop.kept())))
        process.loop.forget()

    def clear(self) -> None:
        """Release all objects at the end of a simulation."""
        for process in tuple(self.processes):
            process.kill()
        for process, tasks, _ in self._graves:
            with self.inside(process):
                for task in tasks:
                    with contextlib.suppress(Exception):  # cleanup of a dead process: it has no effect
                        task.get_coro().close()
        self._graves.clear()
        self._events.clear()

    @contextlib.contextmanager
    def inside(self, process: Process) -> Iterator[None]:
        """Run code of a process, outside of its turns."""
        before, hooks = self.current, sys.get_asyncgen_hooks()
        running = asyncio._get_running_loop()
        self._enter(process)
        try:
            yield
        finally:
            process.next_wake = None
            self.current = before
            asyncio._set_running_loop(running)
            sys.set_asyncgen_hooks(*hooks)

    def _enter(self, process: Process) -> None:
        self.current = process
        asyncio._set_running_loop(process.loop)
        sys.set_asyncgen_hooks(*process.loop.hooks)

    def _ready(self, before: int) -> Process | None:
        """Return a process whose turn comes first, if that is before an event."""
        best, found, now = before, [], self.now
        for process in self.processes:
            wake = process.next_wake
            if wake is None:
                wake = process.wake()
            wake = max(wake, now)
            if wake < best:
                best, found = wake, [process]
            elif wake == best and wake < before:
                found.append(process)
        if not found:
            return None
        return found[0] if len(found) == 1 else found[self._random.randrange(len(found))]

    def _turn(self, process: Process) -> None:
        self.now = max(self.now, process.wake())
        self.turns += 1
        self._call_ns = 1_000 if self._random.random() < 0.98 else 300_000
        self._enter(process)
        process.loop.turn()
        self.current = None
        asyncio._set_running_loop(None)
        process.exit_if_over()
        shortest, longest = _TURN_NS
        used = self._random.randint(shortest, longest + process.delay_ns)
        process.busy_until = max(process.busy_until, self.now + used)
        process.next_wake = None
