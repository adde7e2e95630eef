"""What an RSI reply costs: datagram in → reply out of the link, beside a bare asyncio UDP echo.

Usage: bench_rsi.py [CYCLES]. Link and echo are processes of their own; this one is the KRC, with the
virtual one's controller. In every cycle of 4 ms it sends its telegram to the link, and half a cycle
later the same bytes to the echo, so that both bear the same load. The link's robot moves all the time:
whoever holds it offers a plan at every tick, as the daemon does. A reply that has not come within the
cycle counts as one of 4 ms.
"""

import asyncio
import contextlib
import gc
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from random import Random

import numpy as np
from report import Row, report

from armgate.cell.cell import build_cell
from armgate.cell.config import load_config
from armgate.cell.events import Plan, PlanKey, Tick
from armgate.cell.urdf import read_urdf
from armgate.emulator.krc import PROFILES, Arrival, Context, Controller, Event, Notes, read_ethernet
from armgate.emulator.krc.arm import arm_of_cell
from armgate.emulator.krc.context import Limits
from armgate.links.rsi import RsiDrivenLink, setup_of

CYCLES = int(sys.argv[1]) if len(sys.argv) > 1 and sys.argv[1].isdigit() else 25_000
CYCLE = 0.004
WARM = 250
LATE = 0.003
"""A reply later than this would be in danger on a real KRC, s."""
CONFIGS = Path(__file__).parents[1] / "configs"


# --- the processes that answer ----------------------------------------------------------------------------


class Echo(asyncio.DatagramProtocol):
    def connection_made(self, transport) -> None:
        self.transport = transport

    def datagram_received(self, data: bytes, source) -> None:
        self.transport.sendto(data, source)


async def until_told(port: int) -> None:
    told = asyncio.Event()
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, told.set)
    gc.collect()
    gc.freeze()
    print(port, flush=True)
    await told.wait()


async def echo() -> None:
    loop = asyncio.get_running_loop()
    transport, _ = await loop.create_datagram_endpoint(Echo, local_addr=("127.0.0.1", 0))
    await until_told(transport.get_extra_info("sockname")[1])
    transport.close()


class Holder:
    """Offers a plan at every tick: to and fro, each ending at rest."""

    def __init__(self, link: RsiDrivenLink) -> None:
        self.link, self.taken = link, 0

    def __call__(self, event) -> None:
        if not isinstance(event, Tick):
            return
        step = 1e-4 if event.tick // 500 % 2 else -1e-4
        key = PlanKey("bench", 0, event.tick + 1, event.index)
        increments = tuple((step * share,) * len(event.q) for share in (1.0, 0.75, 0.5, 0.25, 0.0))
        self.taken += self.link.offer(Plan(event.robot, key, event.tick, increments)).accepted


async def link(folder: Path) -> None:
    cell = build_cell(load_config([CONFIGS / "demo.yaml", folder / "link.yaml"]))
    driven = RsiDrivenLink(
        setup_of(cell, cell.robot("FR")), "bench", lambda text: print(text, file=sys.stderr)
    )
    holder = Holder(driven)
    await driven.open(holder)
    await until_told(driven.port)
    print(holder.taken, flush=True)
    driven.close()


# --- the KRC ----------------------------------------------------------------------------------------------

LINK = """armgate: 1
robots:
  FR:
    period: 4 ms
    lag_window: 20 ms
    link: {{kind: rsi, ethernet: {file}, krc: 127.0.0.1, listen: "127.0.0.1:{port}", timeout: 100000}}
"""


def krc(folder: Path) -> Controller:
    robot = build_cell(load_config([CONFIGS / "demo.yaml", folder / "link.yaml"])).robot("FR")
    wide = Limits(1000.0)
    ethernet = read_ethernet((CONFIGS / "rsi" / "axis-correction.xml").read_bytes())
    controller = Controller(
        PROFILES["krc4-rsi3"], Context(precision=6, timeout=10**9, limits=wide, monitor=wide), ethernet,
        arm_of_cell(robot, read_urdf(robot.urdf)), chance=Random(1), notes=Notes(lambda *_, **__: None),
    )  # fmt: skip
    assert controller.operate(Event.START) is None
    return controller


def udp() -> socket.socket:
    return socket.socket(socket.AF_INET, socket.SOCK_DGRAM)


def sleep_until(moment: float) -> None:
    if (ahead := moment - time.perf_counter()) > 0.0:
        time.sleep(ahead)


def ask(own: socket.socket, data: bytes, port: int, until: float) -> tuple[bytes | None, float]:
    """Sends, waits for the answer, at most until then; what came, and after how long."""
    own.setblocking(False)
    with contextlib.suppress(BlockingIOError):  # what came too late
        while own.recv(4096):
            pass
    begun = time.perf_counter()
    own.sendto(data, ("127.0.0.1", port))
    own.settimeout(max(until - begun, 1e-4))
    try:
        return own.recv(4096), time.perf_counter() - begun
    except TimeoutError:
        return None, CYCLE


def measure(controller: Controller, link_port: int, echo_port: int) -> tuple[np.ndarray, np.ndarray]:
    times = np.empty((2, CYCLES))
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as a,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as b,
    ):
        moment, arrivals = time.perf_counter(), []
        for number in range(-WARM, CYCLES):
            telegram = controller.cycle(arrivals)
            assert telegram is not None, controller.status()
            moment = max(moment + CYCLE, time.perf_counter())
            sleep_until(moment)
            reply, took = ask(a, telegram, link_port, moment + CYCLE)
            arrivals = [] if reply is None else [Arrival(reply, took, None)]
            sleep_until(moment + CYCLE / 2)
            bare = ask(b, telegram, echo_port, moment + 1.5 * CYCLE)[1]
            if number >= 0:
                times[:, number] = took, bare
    return times[0], times[1]


@contextlib.contextmanager
def process(*words: str):
    child = subprocess.Popen([sys.executable, __file__, *words], stdout=subprocess.PIPE, text=True)
    try:
        yield child, int(child.stdout.readline())
    finally:
        child.terminate()
        child.wait(10)


def free_port() -> int:
    with udp() as own:
        own.bind(("127.0.0.1", 0))
        return own.getsockname()[1]


def rows(link_times, echo_times, status, taken) -> list[Row]:
    found = []
    for share, factor in ((50.0, 2.0), (99.0, 3.0), (99.9, None)):
        one, bare = (1e6 * float(np.percentile(times, share)) for times in (link_times, echo_times))
        found += [
            Row(f"echo, p{share:g}", bare, "µs"),
            Row(f"link, p{share:g}", one, "µs"),
            Row(f"link / echo, p{share:g}", one / bare, "×", factor),
        ]
    late, bare = (int(np.count_nonzero(times > LATE)) for times in (link_times, echo_times))
    return [
        *found,
        Row("echo, replies later than 3 ms", bare, "of all"),
        Row("link, replies later than 3 ms", late, "of all", bare + 3),
        Row("late cycles that the KRC counted", status["delay"], "of all"),
        Row("plans played", taken, "of all"),
    ]


def main() -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        file = CONFIGS / "rsi" / "axis-correction.xml"
        (folder / "link.yaml").write_text(LINK.format(file=file, port=free_port()))
        controller = krc(folder)
        gc.collect()
        gc.freeze()
        with process("link", name) as (child, link_port), process("echo") as (_, echo_port):
            link_times, echo_times = measure(controller, link_port, echo_port)
            status = controller.status()
            child.terminate()
            taken = int(child.stdout.readline())
    report("rsi", rows(link_times, echo_times, status, taken))


if __name__ == "__main__":
    if sys.argv[1:2] == ["link"]:
        asyncio.run(link(Path(sys.argv[2])))
    elif sys.argv[1:2] == ["echo"]:
        asyncio.run(echo())
    else:
        main()
