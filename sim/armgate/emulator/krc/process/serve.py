"""Virtual KRC as a process: it prints a line when ready, reads commands from stdin, and ends on a signal."""

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

from armgate.emulator.krc.controller import Controller
from armgate.emulator.krc.log import EventLog, JsonLog, SetpointTrace
from armgate.emulator.krc.process.console import Console
from armgate.emulator.krc.process.network import Channel
from armgate.emulator.krc.process.options import Options
from armgate.emulator.krc.process.real_time import RealTimeRunner
from armgate.emulator.krc.states import Event

_MAX_LINE = 4096


async def serve(options: Options, log_file: Path | None, trace: Path | None = None) -> None:
    """Run a virtual KRC until SIGTERM or SIGINT.

    Args:
        options: Options of the KRC.
        log_file: File for its log; None: stderr.
        trace: File for the setpoint of every cycle; None: no trace.
    """
    with _open_log(log_file) as stream, ExitStack() as files:
        log = EventLog(JsonLog(stream))
        chance = Random(f"{options.seed} ipoc")  # noqa: S311  (a simulation, not a secret)
        controller = Controller(
            options.profile, options.context, options.ethernet, options.arm,
            chance=chance, log=log, ipoc=options.ipoc,
        )  # fmt: skip
        channels: dict[str, Channel[Any]] = {
            name: Channel(f"{options.seed} {name}", disturbance)
            for name, disturbance in options.network.items()
        }
        runner = RealTimeRunner(
            controller, options.profile.cycle, options.peer,
            to_pc=channels["to-pc"], to_krc=channels["to-krc"], log=log,
            trace=None if trace is None else _open_trace(files, trace, options.arm.names), port=options.port,
        )  # fmt: skip
        if not options.stopped:
            controller.operate(Event.START)
        await _run(options, runner, Console(controller, channels, runner))
        log.info("end", "ended by a signal", **controller.status(), slips=runner.slips)


async def _run(options: Options, runner: RealTimeRunner, console: Console) -> None:
    loop, ended = asyncio.get_running_loop(), asyncio.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, ended.set)
    # In the background of a shell, reading stdin would stop the whole process.
    signal.signal(signal.SIGTTIN, signal.SIG_IGN)
    host, port = options.peer.address
    _print(f"armgate: {options.profile.name} sends from port {runner.port} to {host}:{port}")
    _read_lines(lambda line: loop.call_soon_threadsafe(lambda: _print(console.answer(line))))
    runner.start()
    try:
        await ended.wait()
    finally:
        runner.close()


def _print(text: str) -> None:
    print(text, flush=True)  # noqa: T201


def _read_lines(receive: Callable[[str], object]) -> None:
    """Call ``receive`` with each line of stdin, from a thread: asyncio cannot read every kind of stdin."""

    def read() -> None:
        rest = b""
        while chunk := _read_chunk():
            *lines, rest = (rest + chunk).split(b"\n")
            for line in lines:
                receive(line.decode(errors="replace"))
            rest = rest[:_MAX_LINE]

    threading.Thread(target=read, name="console", daemon=True).start()


def _read_chunk() -> bytes:
    try:
        return os.read(0, _MAX_LINE)
    except OSError:  # stdin is closed, or belongs to another process group
        return b""


@contextmanager
def _open_log(path: Path | None) -> Iterator[TextIO]:
    if path is None:
        yield sys.stderr
        return
    with path.open("a", encoding="utf-8") as stream:
        yield stream


def _open_trace(files: ExitStack, path: Path, names: Sequence[str]) -> Callable[[Mapping[str, object]], None]:
    stream = files.enter_context(path.open("w", 1, encoding="utf-8", newline=""))
    return SetpointTrace(stream, names).write
