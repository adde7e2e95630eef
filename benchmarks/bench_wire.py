"""Cost of the wire: command to verdict compared with a bare asyncio msgpack echo, and 50 observers with none.

Usage: bench_wire.py [TICKS]. Daemon, echo and observers are separate processes; this one is the controller
and calls the echo. Both calls are made at every tick, each first in turn. The time that the gate took to
decide is measured in the daemon and subtracted command by command. Blocks of ticks with and without observers
alternate.
"""

import asyncio
import contextlib
import io
import itertools
import json
import signal
import sys
import tempfile
from pathlib import Path
from time import monotonic_ns, perf_counter_ns, process_time_ns

import msgpack
import numpy as np
from report import Row, report

from armgate.cell.cell import build_cell
from armgate.cell.config import load_config
from armgate.daemon.lifecycle.daemon import Daemon
from armgate.emulator.clock import Lateness
from armgate.events import Command
from armgate.gate import Gate
from armgate.links.log import Log

TICKS = int(sys.argv[1]) if len(sys.argv) > 1 and sys.argv[1].isdigit() else 2400
OBSERVERS = 50
WARM = 100
BLOCK = 250
"""Ticks of a block with or without observers."""
SETTLE = 25
"""Ticks at the start of a block that do not count."""


# --- frames without a protocol library --------------------------------------------------------------------


def framed(message) -> bytes:
    payload = msgpack.packb(message)
    return len(payload).to_bytes(4, "big") + payload


class Framed(asyncio.Protocol):
    """A protocol that passes every message to ``take``."""

    def __init__(self, take) -> None:
        self.take, self.buffer = take, bytearray()

    def connection_made(self, transport) -> None:
        self.transport = transport

    def data_received(self, data: bytes) -> None:
        self.buffer += data
        while len(self.buffer) >= 4 and len(self.buffer) >= (
            end := 4 + int.from_bytes(self.buffer[:4], "big")
        ):
            payload = bytes(self.buffer[4:end])
            del self.buffer[:end]
            self.take(self, msgpack.unpackb(payload))

    def send(self, message) -> None:
        self.transport.write(framed(message))


# --- the other processes ----------------------------------------------------------------------------------


async def echo() -> None:
    """Answer every message but the first with the first, which is packed anew each time."""
    answers = {}

    def take(wire: Framed, message) -> None:
        if wire in answers:
            wire.send(answers[wire])
        else:
            answers[wire] = message

    server = await asyncio.get_running_loop().create_server(lambda: Framed(take), "127.0.0.1", 0)
    print(server.sockets[0].getsockname()[1], flush=True)
    await server.serve_forever()


async def observe(port: str) -> None:
    """Run fifty observers, which subscribe while the last line on stdin was "on"."""
    loop = asyncio.get_running_loop()
    wires = []
    for number in range(OBSERVERS):
        _, wire = await loop.create_connection(Reader, "127.0.0.1", int(port))
        wire.transport.write(
            framed({"type": "hello", "versions": [1], "name": f"eye{number}", "role": "observer"})
        )
        wires.append(wire)
    print("ready", flush=True)
    lines = asyncio.StreamReader()
    await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(lines), sys.stdin)
    while line := await lines.readline():
        if line == b"count\n":
            print(sum(wire.count for wire in wires), flush=True)
            return
        for wire in wires:
            wire.transport.write(framed({"type": "subscribe", "every": int(line == b"on\n")}))


class Reader(asyncio.Protocol):
    """A protocol that counts bytes."""

    def connection_made(self, transport) -> None:
        self.transport, self.count = transport, 0

    def data_received(self, data: bytes) -> None:
        self.count += len(data)


async def serve(config: str, out: str) -> None:
    """Run the daemon, with a clock at its gate and one at its ticks."""
    decisions, ticks = {}, []

    class Timed(Gate):
        def step(self, event):
            begin = perf_counter_ns()
            outputs = super().step(event)
            if isinstance(event, Command):
                decisions[event.seq] = perf_counter_ns() - begin
            return outputs

    class Noted(Lateness):
        def note(self, late_ns: int, gap_ns: int) -> None:
            ticks.append((monotonic_ns(), late_ns, process_time_ns()))
            super().note(late_ns, gap_ns)

    daemon = Daemon(
        build_cell(load_config([Path(part) for part in config.split(",")])), Timed, Log(io.StringIO())
    )
    daemon._pace._clock.lateness = Noted()
    await daemon.run(lambda host, port: print(port, flush=True))
    dump = json.dumps({"decisions": decisions, "ticks": ticks})
    await asyncio.to_thread(Path(out).write_text, dump, encoding="utf-8")


# --- the controller ---------------------------------------------------------------------------------------


class Calls:
    """One connection with one outstanding request at a time."""

    def __init__(self, loop) -> None:
        self.loop, self.answer, self.states = loop, None, asyncio.Queue()

    async def connect(self, port: int) -> "Calls":
        _, self.wire = await self.loop.create_connection(lambda: Framed(self.take), "127.0.0.1", port)
        return self

    def take(self, _, message) -> None:
        if message.get("type") == "state":
            self.states.put_nowait(message)
        elif self.answer is not None and not self.answer.done():
            self.answer.set_result(message)

    async def ask(self, message):
        """Return the answer, and the time that it took, ns."""
        self.answer = self.loop.create_future()
        begin = perf_counter_ns()
        self.wire.send(message)
        answer = await asyncio.wait_for(self.answer, 10)
        return answer, perf_counter_ns() - begin


async def controller(port: int, echo_port: int, observers) -> dict:
    loop = asyncio.get_running_loop()
    daemon, bare = await Calls(loop).connect(port), await Calls(loop).connect(echo_port)
    await daemon.ask({"type": "hello", "versions": [1], "name": "bench"})
    lease, _ = await daemon.ask({"type": "acquire", "robot": "FR", "id": 1})
    await daemon.ask({"type": "subscribe", "robots": ["FR"], "fields": ["setpoint"]})
    verdict = {}
    took, echoed, blocks, refused, sizes = {}, {}, [], 0, (0, 0)
    for seq in range(WARM + TICKS):
        if seq >= WARM and (seq - WARM) % BLOCK == 0:
            on = (seq - WARM) // BLOCK % 2 == 1
            blocks.append((on, monotonic_ns()))
            observers.stdin.write(b"on\n" if on else b"off\n")
        state = await daemon.states.get()
        while not daemon.states.empty():
            state = daemon.states.get_nowait()
        dq = [0.002 * np.sin(0.02 * seq) * min(1.0, seq / 100), 0.0, 0.0, 0.0, 0.0, 0.0]
        command = {
            "type": "command", "robot": "FR", "fence": lease["fence"], "seq": seq, "tick": state["tick"],
            "dq": [float(x) for x in dq],
        }  # fmt: skip
        if seq == WARM:
            sizes = (len(framed(command)), len(framed(verdict)))
            bare.wire.send(verdict)
        if seq > WARM and seq % 2:
            echoed[seq] = (await bare.ask(command))[1]
        verdict, spent = await daemon.ask(command)
        if seq > WARM and not seq % 2:
            echoed[seq] = (await bare.ask(command))[1]
        if seq >= WARM:
            took[seq] = spent
            refused += verdict["outcome"] == "refused"
    blocks.append((False, monotonic_ns()))
    return {"took": took, "echoed": echoed, "blocks": blocks, "refused": refused, "sizes": sizes}


@contextlib.asynccontextmanager
async def role(*arguments: str):
    """Run this file in another role; its first line of output reports that it is ready."""
    process = await asyncio.create_subprocess_exec(
        sys.executable, __file__, *arguments, stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE
    )
    try:
        first = (await process.stdout.readline()).decode().strip()
        if not first:
            sys.exit(f"{arguments[0]} did not start: see above")
        yield process, first
    finally:
        if process.returncode is None:
            process.send_signal(signal.SIGINT if arguments[0] == "serve" else signal.SIGKILL)
        await process.communicate()


async def measure(folder: Path) -> tuple[dict, dict]:
    overlay = folder / "server.yaml"
    overlay.write_text("armgate: 1\nserver: {port: 0, connection_rate: 1000}\n", encoding="utf-8")
    demo = Path(__file__).parent.parent / "configs" / "demo.yaml"
    out = folder / "daemon.json"
    async with (
        role("echo") as (_, echo_port),
        role("serve", f"{demo},{overlay}", str(out)) as (_, port),
        role("observe", port) as (observers, _),
    ):
        seen = await controller(int(port), int(echo_port), observers)
        observers.stdin.write(b"count\n")
        seen["read"] = int(await observers.stdout.readline())
    return seen, json.loads(out.read_text(encoding="utf-8"))


def us(values, percentile: float) -> float:
    return float(np.percentile(values, percentile)) / 1e3


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        seen, daemon = asyncio.run(measure(Path(folder)))
    decided = {int(seq): ns for seq, ns in daemon["decisions"].items()}
    rows = []
    for on, what in ((False, ""), (True, ", 50 observers")):
        inside = [seq for seq in seen["echoed"] if (seq - WARM) // BLOCK % 2 == on]
        wire = [seen["took"][seq] - decided[seq] for seq in inside]
        bare = [seen["echoed"][seq] for seq in inside]
        goals = (None, None) if on else (2.0, 3.0)
        rows += [
            Row(f"verdict less decision / echo{what}: median", us(wire, 50) / us(bare, 50), "1", goals[0]),
            Row(f"verdict less decision / echo{what}: p99", us(wire, 99) / us(bare, 99), "1", goals[1]),
            Row(f"verdict less decision{what}: median", us(wire, 50), "µs"),
            Row(f"verdict less decision{what}: p99", us(wire, 99), "µs"),
            Row(f"echo{what}: median", us(bare, 50), "µs"),
            Row(f"echo{what}: p99", us(bare, 99), "µs"),
        ]
    late, busy = {True: [], False: []}, {True: [], False: []}
    for (on, begin), (_, end) in zip(seen["blocks"], seen["blocks"][1:], strict=False):
        inside = [tick for tick in daemon["ticks"] if begin <= tick[0] < end][SETTLE:]
        late[on] += [late_ns for _, late_ns, _ in inside]
        busy[on] += [after[2] - before[2] for before, after in itertools.pairwise(inside)]
    rows += [
        Row("decision: median", us(list(decided.values()), 50), "µs"),
        Row("command", seen["sizes"][0], "bytes"),
        Row("verdict", seen["sizes"][1], "bytes"),
        Row("refused", seen["refused"] / len(seen["took"]), "share"),
        Row("50 observers add to p99 lateness", (us(late[True], 99) - us(late[False], 99)) / 1e3, "ms", 1.0),
    ]
    for on, what in ((False, "without"), (True, "with")):
        rows += [
            Row(f"lateness {what} observers: median", us(late[on], 50) / 1e3, "ms"),
            Row(f"lateness {what} observers: p99", us(late[on], 99) / 1e3, "ms"),
            Row(f"daemon's CPU per tick {what} observers: median", us(busy[on], 50) / 1e3, "ms"),
        ]
    rows.append(Row("an observer read per tick", seen["read"] / OBSERVERS / len(late[True]), "bytes"))
    report("wire", rows)


ROLES = {"echo": echo, "serve": serve, "observe": observe}

if __name__ == "__main__":
    if len(sys.argv) > 1 and sys.argv[1] in ROLES:
        asyncio.run(ROLES[sys.argv[1]](*sys.argv[2:]))
    else:
        main()
