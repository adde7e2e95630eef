"""Latency of RSI replies: telegram in to reply out of the robot server, beside a bare asyncio UDP echo.

Usage: bench_rsi.py [CYCLES]. Each part is a process of its own and runs as a user starts it: the robot
server with both robots of the demo cell, the daemon with its gate, two controllers that command at every
tick, an observer, a virtual KRC for GR. This process is the KRC of FR, with the controller of the virtual
KRC. In every cycle of 4 ms it sends its telegram to the robot server, and half a cycle later the same bytes
to the echo, so that both have the same load. A reply that does not arrive within the cycle counts as 4 ms.
If real-time priorities are allowed, all parts run before ordinary programs: robot server and echo at one
priority, daemon and clients below them, and the KRCs, which stand for other machines, above.
"""

import asyncio
import contextlib
import gc
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from random import Random

import numpy as np
from report import Row, report

from armgate.cell.cell import build_cell
from armgate.cell.config import load_config
from armgate.cell.urdf import read_urdf
from armgate.client import connect
from armgate.emulator.krc import PROFILES, Arrival, Context, Controller, Event, EventLog, read_ethernet
from armgate.emulator.krc.context import Limits
from armgate.emulator.krc.robot.arm import arm_of_cell

CYCLES = int(sys.argv[1]) if len(sys.argv) > 1 and sys.argv[1].isdigit() else 25_000
CYCLE = 0.004
WARM = 500
LATE = 0.003
"""Latency of a reply that a real KRC could count as late, s."""
CONFIGS = Path(__file__).parents[1] / "configs"
KRC_PRIORITY, PRIORITY, CLIENT_PRIORITY = 30, 20, 10
"""Real-time priorities of the KRCs, of robot server and echo, and of daemon and clients."""
START = 60.0
"""Timeout for the start of the stack, until its robots move, s."""


# --- the other processes ----------------------------------------------------------------------------------


def set_real_time_priority(priority: int, pid: int = 0) -> bool:
    """Run a process, by default this one, before ordinary programs. Return True if that is allowed."""
    try:
        os.sched_setscheduler(pid, os.SCHED_RR, os.sched_param(priority))
    except PermissionError:
        return False
    return True


class Echo(asyncio.DatagramProtocol):
    def connection_made(self, transport) -> None:
        self.transport = transport

    def datagram_received(self, data: bytes, source) -> None:
        self.transport.sendto(data, source)


async def echo() -> None:
    loop = asyncio.get_running_loop()
    transport, _ = await loop.create_datagram_endpoint(Echo, local_addr=("127.0.0.1", 0))
    gc.collect()
    gc.freeze()
    print(transport.get_extra_info("sockname")[1], flush=True)
    await asyncio.Event().wait()


def raise_interrupt(*_) -> None:
    raise KeyboardInterrupt


def move(address: str, robot: str) -> None:
    """Move one joint back and forth with a command at every tick, and print the number of each outcome."""
    outcomes = {"admitted": 0, "limited": 0, "refused": 0}
    with connect(address, name=f"mover-{robot}") as cell:
        for state in cell.states():
            if len(state.entries) == 2 and all(entry.link == "ready" and entry.q for entry in state.entries):
                break
        with contextlib.suppress(KeyboardInterrupt), cell.acquire(robot) as held:
            for tick in held.ticks():
                dq = [0.0] * len(tick.setpoint)
                dq[-6] = 0.0008 * np.sin(2.0 * tick.time)
                held.post(dq)
                for verdict in held.verdicts():
                    outcomes[verdict.outcome] += 1
                if outcomes["admitted"] == 50:
                    print("moves", flush=True)
    print(json.dumps(outcomes), flush=True)


def observe(address: str) -> None:
    """Observe all states, and print their number."""
    count = 0
    with connect(address, name="eye", role="observer") as cell, contextlib.suppress(KeyboardInterrupt):
        cell.subscribe(every=1)
        print("looks", flush=True)
        for _ in cell.states(backlog=10_000):
            count += 1
    print(json.dumps({"states": count}), flush=True)


# --- the KRC ----------------------------------------------------------------------------------------------

LINKS = """armgate: 1
server: {{port: 0}}
robots:
  FR:
    period: 4 ms
    lag_window: 20 ms
    link: {{kind: rsi, ethernet: {rsi}/axis-correction.xml, krc: 127.0.0.1, listen: 127.0.0.1:{FR}, {late}}}
  GR:
    period: 4 ms
    lag_window: 20 ms
    link:
      {{kind: rsi, ethernet: {rsi}/gantry-correction.xml, krc: 127.0.0.1, listen: 127.0.0.1:{GR}, {late}}}
"""
TOLERANCE = "timeout: 1000000, late_in_a_row: 1000, silence: 4 s"
"""Large timeouts: a busy machine must not end the run; late replies appear in the figures."""


def krc(cell) -> Controller:
    robot = cell.robot("FR")
    wide = Limits(1000.0)
    ethernet = read_ethernet((CONFIGS / "rsi" / "axis-correction.xml").read_bytes())
    controller = Controller(
        PROFILES["krc4-rsi3"], Context(precision=6, timeout=10**9, limits=wide, monitor=wide), ethernet,
        arm_of_cell(robot, read_urdf(robot.urdf)), chance=Random(1), log=EventLog(lambda *_, **__: None),
    )  # fmt: skip
    assert controller.operate(Event.START) is None
    return controller


def sleep_until(moment: float) -> None:
    if (ahead := moment - time.perf_counter()) > 0.0:
        time.sleep(ahead)


def ask(own: socket.socket, data: bytes, port: int, until: float) -> tuple[bytes | None, float]:
    """Send data, wait for an answer until a time; return it (None if there is none) and its delay, s."""
    own.setblocking(False)
    with contextlib.suppress(BlockingIOError):  # drop answers that came too late
        while own.recv(4096):
            pass
    begun = time.perf_counter()
    own.sendto(data, ("127.0.0.1", port))
    own.settimeout(max(until - begun, 1e-4))
    try:
        return own.recv(4096), time.perf_counter() - begun
    except TimeoutError:
        return None, CYCLE


class Krc:
    """KRC of FR, and client of the echo, cycle by cycle."""

    def __init__(self, controller: Controller, link_port: int, echo_port: int) -> None:
        self.controller, self.ports = controller, (link_port, echo_port)
        self.sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2)]
        self.arrivals: list[Arrival] = []
        self.moment = time.perf_counter()

    def cycle(self) -> tuple[float, float]:
        """Return the latencies of link and echo in one cycle, s."""
        telegram = self.controller.cycle(self.arrivals)
        assert telegram is not None, self.controller.status()
        self.moment = max(self.moment + CYCLE, time.perf_counter())
        sleep_until(self.moment)
        reply, took = ask(self.sockets[0], telegram, self.ports[0], self.moment + CYCLE)
        self.arrivals = [] if reply is None else [Arrival(reply, took, None)]
        sleep_until(self.moment + CYCLE / 2)
        return took, ask(self.sockets[1], telegram, self.ports[1], self.moment + 1.5 * CYCLE)[1]


# --- the run ----------------------------------------------------------------------------------------------


class Crew(contextlib.ExitStack):
    """Processes, killed at the end, the last one first."""

    def __init__(self) -> None:
        super().__init__()
        self.pids: dict[str, int] = {}

    def start(self, priority: int, *words: object, ready: str | None = "") -> tuple[subprocess.Popen, str]:
        """Start a process; return it and its first line, which begins with ``ready`` (None: do not wait)."""
        child = subprocess.Popen([sys.executable, *map(str, words)], stdout=subprocess.PIPE, text=True)
        set_real_time_priority(priority, child.pid)
        # The name is the role of this file with its robot, or the command of armgate.
        self.pids[str(words[2]) if words[0] == "-m" else " ".join((words[1], *words[3:]))] = child.pid
        self.callback(child.wait)
        self.callback(child.kill)
        return child, "" if ready is None else self.line(child, ready)

    def cpu(self) -> dict[str, float]:
        """Return the processor time that each process has used so far, s."""
        found = {}
        for name, pid in self.pids.items():
            fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
            found[name] = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
        return found

    def line(self, child: subprocess.Popen, ready: str) -> str:
        line = child.stdout.readline().strip()
        if not line or not line.startswith(ready):
            sys.exit(f"{' '.join(child.args[1:5])} did not start: {line!r}")
        return line


def free_ports(count: int) -> list[int]:
    with contextlib.ExitStack() as stack:
        socks = [stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) for _ in range(count)]
        for sock in socks:
            sock.bind(("127.0.0.1", 0))
        return [sock.getsockname()[1] for sock in socks]


def stack(crew: Crew, folder: Path, ports: list[int]):
    """Start robot server, GR's KRC, daemon, observer and controllers; return observer and controllers."""
    armgate = ("-m", "armgate.apps")
    configs = [CONFIGS / "demo.yaml", folder / "links.yaml"]
    urgent = ("--priority", PRIORITY) if set_real_time_priority(KRC_PRIORITY) else ()
    robots = ("robot-server", *configs, "--socket", folder / "s", *urgent)
    crew.start(PRIORITY, *armgate, *robots, ready="armgate: robot server")
    other = (
        "krc", "--profile", "krc4-rsi3", "--config", CONFIGS / "rsi" / "gantry-correction.xml",
        *(word for config in configs for word in ("--cell", config)), "--robot", "GR",
        "--to", f"127.0.0.1:{ports[1]}", "--precision", 6, "--timeout", 10**9,
        "--axiscorr", "100000", "--axiscorrmon", "100001", "--log", folder / "krc.log",
    )  # fmt: skip
    crew.start(KRC_PRIORITY, *armgate, *other, ready="armgate: krc4")
    daemon = ("serve", *configs, "--robot-server", folder / "s")
    _, line = crew.start(CLIENT_PRIORITY, *armgate, *daemon, ready="armgate: listening on ")
    address = line.rpartition(" ")[2]
    eye, _ = crew.start(CLIENT_PRIORITY, __file__, "observe", address, ready="looks")
    movers = [
        crew.start(CLIENT_PRIORITY, __file__, "move", address, robot, ready=None)[0] for robot in ("FR", "GR")
    ]
    return eye, movers


def measure(folder: Path) -> tuple[np.ndarray, dict, list[dict]]:
    ports = free_ports(2)
    named = dict(zip(("FR", "GR"), ports, strict=True))
    (folder / "links.yaml").write_text(LINKS.format(rsi=CONFIGS / "rsi", late=TOLERANCE, **named))
    controller = krc(build_cell(load_config([CONFIGS / "demo.yaml", folder / "links.yaml"])))
    with Crew() as crew:
        _, echo_port = crew.start(PRIORITY, __file__, "echo")
        eye, movers = stack(crew, folder, ports)
        moving = threading.Thread(target=lambda: [crew.line(one, "moves") for one in movers], daemon=True)
        moving.start()
        own = Krc(controller, ports[0], int(echo_port))
        gc.collect()
        gc.freeze()
        until = time.perf_counter() + START
        while moving.is_alive():
            own.cycle()
            if time.perf_counter() > until:
                sys.exit("the robots do not move; see above")
        for _ in range(WARM):
            own.cycle()
        before, cpu = controller.status()["delay"], crew.cpu()
        times = np.array([own.cycle() for _ in range(CYCLES)]).T
        status = controller.status()
        status["delay"] -= before
        busy = {name: (one - cpu[name]) / (CYCLES * CYCLE) for name, one in crew.cpu().items()}
        told = []
        for child in (eye, *movers):
            child.send_signal(signal.SIGTERM)
            told.append(json.loads(child.stdout.readline()))
        return times, {**status, "busy": busy}, told


def rows(link_times, echo_times, status, told) -> list[Row]:
    found = []
    for share, factor in ((50.0, 2.0), (99.0, 3.0), (99.9, None)):
        one, bare = (1e6 * float(np.percentile(times, share)) for times in (link_times, echo_times))
        found += [
            Row(f"echo, p{share:g}", bare, "µs"),
            Row(f"link, p{share:g}", one, "µs"),
            Row(f"link / echo, p{share:g}", one / bare, "×", factor),
        ]
    late, bare_late = (int(np.count_nonzero(times > LATE)) for times in (link_times, echo_times))
    missed = int(np.count_nonzero(echo_times >= CYCLE))
    eye, *movers = told
    labels = [f"{robot}: commands {{}}" for robot in ("FR", "GR")]
    return [
        *found,
        Row("echo, replies later than 3 ms", bare_late, f"of {CYCLES}"),
        Row("link, replies later than 3 ms", late, f"of {CYCLES}", bare_late + 3),
        Row("echo, later than the cycle", missed, f"of {CYCLES}"),
        Row("link, late cycles that the KRC counted (Delay)", status["delay"], f"of {CYCLES}", missed),
        *(
            Row(name.format(outcome), count, "")
            for name, outcomes in zip(labels, movers, strict=True)
            for outcome, count in outcomes.items()
        ),
        Row("states that the observer received", eye["states"], ""),
        *(Row(f"{name}: share of a core", share, "") for name, share in status["busy"].items()),
    ]


def main() -> None:
    with tempfile.TemporaryDirectory() as name:
        times, status, told = measure(Path(name))
    report("rsi", rows(*times, status, told))


if __name__ == "__main__":
    role, *words = sys.argv[1:] or [""]
    if role in ("move", "observe"):
        signal.signal(signal.SIGTERM, raise_interrupt)
        {"move": move, "observe": observe}[role](*words)
    elif role == "echo":
        asyncio.run(echo())
    else:
        main()
