"""A virtual KRC as a process: it says when it is ready, obeys lines on stdin, and ends on a signal."""

import asyncio
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from random import Random
from typing import Any, TextIO

from armgate.emulator.krc.control import Control
from armgate.emulator.krc.controller import Controller
from armgate.emulator.krc.log import Log
from armgate.emulator.krc.machine import Event
from armgate.emulator.krc.network import Channel
from armgate.emulator.krc.notes import Notes
from armgate.emulator.krc.setup import Setup
from armgate.emulator.krc.station import Station
from armgate.emulator.krc.trace import Trace

_LONGEST = 4096


async def serve(setup: Setup, log: Path | None, trace: Path | None = None) -> None:
    """Run until SIGTERM or SIGINT.

    Args:
        setup: The KRC.
        log: Where its log goes; stderr if None.
        trace: Where the setpoint of every cycle goes.
    """
    with _logged(log) as stream, ExitStack() as files:
        notes = Notes(Log(stream))
        chance = Random(f"{setup.seed} ipoc")  # noqa: S311  (a course of events, not a secret)
        controller = Controller(
            setup.profile, setup.context, setup.ethernet, setup.arm,
            chance=chance, notes=notes, ipoc=setup.ipoc,
        )  # fmt: skip
        channels: dict[str, Channel[Any]] = {
            name: Channel(f"{setup.seed} {name}", how) for name, how in setup.network.items()
        }
        station = Station(
            controller, setup.profile.cycle, setup.peer,
            to_pc=channels["to-pc"], to_krc=channels["to-krc"], notes=notes,
            trace=None if trace is None else _traced(files, trace, setup.arm.names), port=setup.port,
        )  # fmt: skip
        if not setup.stopped:
            controller.operate(Event.START)
        await _run(setup, station, Control(controller, channels, station))
        notes.info("end", "told to end", **controller.status(), slips=station.slips)


async def _run(setup: Setup, station: Station, control: Control) -> None:
    loop, ended = asyncio.get_running_loop(), asyncio.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, ended.set)
    # In the background of a shell, reading stdin would halt the whole process.
    signal.signal(signal.SIGTTIN, signal.SIG_IGN)
    host, port = setup.peer.address
    _say(f"armgate: {setup.profile.name} sends from port {station.port} to {host}:{port}")
    _read_lines(lambda line: loop.call_soon_threadsafe(lambda: _say(control.answer(line))))
    station.start()
    try:
        await ended.wait()
    finally:
        station.close()


def _say(text: str) -> None:
    print(text, flush=True)  # noqa: T201


def _read_lines(take: Callable[[str], object]) -> None:
    """Hand on stdin line by line, from a thread: not everything that stdin can be is awaitable."""

    def read() -> None:
        rest = b""
        while chunk := _chunk():
            *lines, rest = (rest + chunk).split(b"\n")
            for line in lines:
                take(line.decode(errors="replace"))
            rest = rest[:_LONGEST]

    threading.Thread(target=read, name="control", daemon=True).start()


def _chunk() -> bytes:
    try:
        return os.read(0, _LONGEST)
    except OSError:  # there is no stdin, or it is not ours to read
        return b""


@contextmanager
def _logged(path: Path | None) -> Iterator[TextIO]:
    if path is None:
        yield sys.stderr
        return
    with path.open("a", encoding="utf-8") as stream:
        yield stream


def _traced(files: ExitStack, path: Path, names: Sequence[str]) -> Callable[[Mapping[str, object]], None]:
    return Trace(files.enter_context(path.open("w", 1, encoding="utf-8", newline="")), names).take
