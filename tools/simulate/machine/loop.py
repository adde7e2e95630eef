"""Event loop of a simulated process: asyncio's own, with a simulated clock, selector and signals.

Callbacks, timers, tasks, transports and servers are asyncio's own code. Only the parts that enter the kernel
are replaced: the clock, the selector, the resolution of names and signals.
"""

import asyncio
import selectors
import socket
from collections.abc import Callable, Iterable, Mapping
from heapq import heappop
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tools.simulate.machine.machine import Process

NEVER = 1 << 62
"""Time that is never reached, ns."""


class Selector(selectors.BaseSelector):
    """Selector of simulated files, by their descriptors; it never waits.

    Attributes:
        changed: True if a file may have become ready since the last call of ``select``.
    """

    def __init__(self) -> None:
        self._keys: dict[int, selectors.SelectorKey] = {}
        self.files: dict[int, Any] = {}
        self.changed = False

    def register(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:
        """Watch a file."""
        number = _number(fileobj)
        key = self._keys[number] = selectors.SelectorKey(fileobj, number, events, data)
        self.changed = True
        return key

    def unregister(self, fileobj: Any) -> selectors.SelectorKey:
        """Stop watching a file."""
        return self._keys.pop(_number(fileobj))

    def modify(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:
        """Watch a file for other events."""
        self._keys.pop(_number(fileobj))
        return self.register(fileobj, events, data)

    def get_key(self, fileobj: Any) -> selectors.SelectorKey:
        """Return the key of a file."""
        return self._keys[_number(fileobj)]

    def get_map(self) -> Mapping[Any, selectors.SelectorKey]:
        """Return all keys."""
        return self._keys

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        """Return the files that are ready."""
        found = []
        for number, key in self._keys.items():
            file = self.files.get(number)
            if file is not None and (events := file.ready() & key.events):
                found.append((key, events))
        self.changed = bool(found)
        return found


def _number(fileobj: Any) -> int:
    return fileobj if isinstance(fileobj, int) else int(fileobj.fileno())


class SimulatedLoop(asyncio.SelectorEventLoop):
    """Event loop of one simulated process.

    Attributes:
        selector: Its selector.
        signals: Handlers of signals.
        tasks: Its tasks.
    """

    def __init__(self, process: "Process") -> None:
        self.selector = Selector()
        self.signals: dict[int, tuple[Callable[..., Any], tuple[Any, ...]]] = {}
        self.tasks: dict[asyncio.Task[Any], None] = {}
        self._process = process
        super().__init__(self.selector)
        own: Any = self
        own._clock_resolution = 1e-9
        self.hooks = own._asyncgen_firstiter_hook, own._asyncgen_finalizer_hook

    def time(self) -> float:
        """Return the time of the machine, s."""
        return self._process.machine.now / 1e9

    def wake(self) -> int:
        """Return the time at which there is something to do, ns."""
        own: Any = self
        if own._ready or self.selector.changed:
            return 0
        scheduled = own._scheduled
        while scheduled and scheduled[0]._cancelled:
            own._timer_cancelled_count -= 1
            heappop(scheduled)._scheduled = False
        return int(scheduled[0]._when * 1e9) + 1 if scheduled else NEVER

    def turn(self) -> None:
        """Do one turn: poll, then run what is ready."""
        own: Any = self
        own._run_once()

    def create_task(self, coro: Any, **options: Any) -> Any:
        """Return a new task."""
        task = super().create_task(coro, **options)
        self.tasks[task] = None
        task.add_done_callback(self._forget_task)
        return task

    def _forget_task(self, task: "asyncio.Task[Any]") -> None:
        self.tasks.pop(task, None)

    def add_signal_handler(self, sig: int, callback: Any, *args: Any) -> None:  # type: ignore[override]
        """Handle a signal."""
        self.signals[int(sig)] = callback, args

    def remove_signal_handler(self, sig: int) -> bool:
        """Remove the handler of a signal."""
        return self.signals.pop(int(sig), None) is not None

    async def getaddrinfo(self, host: Any, port: Any, **_: Any) -> Any:
        """Return the address itself: there are no names in the simulated network."""
        return [(socket.AF_INET, socket.SOCK_STREAM, socket.IPPROTO_TCP, "", (host, port))]

    def call_exception_handler(self, context: dict[str, Any]) -> None:
        """Note an exception that no code has handled, and pass it to the handler of the process."""
        error = context.get("exception")
        if not isinstance(error, OSError):
            self._process.machine.problems.append(
                f"{self._process.name}: unhandled: {context.get('message')}: {error!r}"
            )
        if self.get_exception_handler() is not None:
            super().call_exception_handler(context)

    def kept(self) -> Iterable[Any]:
        """Return all objects that wait for their turn."""
        own: Any = self
        return [*own._ready, *own._scheduled, dict(self.selector.get_map())]

    def forget(self) -> None:
        """Remove all waiting objects: the process is dead."""
        own: Any = self
        own._ready.clear()
        own._scheduled.clear()
        for task in self.tasks:
            task._log_destroy_pending = False  # type: ignore[attr-defined]

    def _check_closed(self) -> None:
        """Accept what coroutines of dead processes do when they are collected: it has no effect."""

    def __del__(self) -> None:
        """Do nothing: the loop uses nothing of the system."""

    def _make_self_pipe(self) -> None:
        """Make no pipe: there are no threads."""

    def _close_self_pipe(self) -> None:
        """Close no pipe."""

    def _write_to_self(self) -> None:
        """Wake no thread."""
