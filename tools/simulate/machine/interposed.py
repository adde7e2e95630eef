"""Clocks and random numbers of the simulated machine, in place of those of the standard library.

`install` replaces functions of ``time`` and ``secrets`` once, before armgate is imported, because modules
bind these names when they are imported. The replacements return the values of the machine that runs, and
those of the real machine otherwise. Sockets are replaced only while a machine runs.
"""

import secrets
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Protocol


class Source(Protocol):
    """Values that a simulated machine provides."""

    def monotonic_ns(self) -> int:
        """Return the time of the machine, ns."""

    def epoch_ns(self) -> int:
        """Return the time of day, ns since 1970."""

    def processor_ns(self) -> int:
        """Return the processor time that the running process has used, ns."""

    def random_bytes(self, count: int) -> bytes:
        """Return random bytes."""


_REAL_HEX = secrets.token_hex
_REAL_SOCKET = socket.socket
_running: Source | None = None


def _clock(real: Callable[[], Any], simulated: Callable[[Source], Any]) -> Callable[[], Any]:
    def read() -> Any:
        return real() if _running is None else simulated(_running)

    return read


def _token_hex(nbytes: int | None = None) -> str:
    return _REAL_HEX(nbytes) if _running is None else _running.random_bytes(nbytes or 32).hex()


_REPLACED: dict[str, Callable[[], Any]] = {
    "monotonic": _clock(time.monotonic, lambda machine: machine.monotonic_ns() / 1e9),
    "monotonic_ns": _clock(time.monotonic_ns, lambda machine: machine.monotonic_ns()),
    "perf_counter": _clock(time.perf_counter, lambda machine: machine.processor_ns() / 1e9),
    "time": _clock(time.time, lambda machine: machine.epoch_ns() / 1e9),
    "time_ns": _clock(time.time_ns, lambda machine: machine.epoch_ns()),
}


def install() -> None:
    """Replace the functions of the standard library."""
    for name, function in _REPLACED.items():
        setattr(time, name, function)
    secrets.token_hex = _token_hex


@contextmanager
def running(machine: Source, sockets: Any, timer: Any) -> Iterator[None]:
    """Take clocks, random numbers, sockets and kernel timers from this machine."""
    from armgate.emulator import clock  # noqa: PLC0415 (after `install`)

    emulated: Any = clock
    global _running  # noqa: PLW0603 (one machine at a time, as there is one standard library)
    _running = machine
    socket.socket = sockets  # type: ignore[misc]
    real_timer, emulated.Timer = emulated.Timer, timer
    try:
        yield
    finally:
        _running = None
        socket.socket = _REAL_SOCKET  # type: ignore[misc]
        emulated.Timer = real_timer
