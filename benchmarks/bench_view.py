"""Cost of a viewer for the daemon: lateness of its ticks with a page connected and not connected.

Usage: bench_view.py [PATHS]. Daemon, leader and follower run as in the demo, with the viewer in addition; a
headless Chromium shows its page. Blocks in which the page is connected alternate with blocks in which it is
open and not connected. The page counts the messages that arrive. The leader plays its path PATHS times.
"""

import asyncio
import contextlib
import io
import json
import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path
from time import monotonic, monotonic_ns, sleep

import numpy as np
from report import Row, report

from armgate.apps.stack.child import end_with, set_priority
from armgate.apps.stack.plan import ORDINARY, PRIORITIES
from armgate.cell.cell import build_cell
from armgate.cell.config import load_config
from armgate.client import connect
from armgate.daemon.lifecycle.daemon import Daemon
from armgate.emulator.clock import Lateness
from armgate.gate import Gate
from armgate.links.log import Log

ROOT = Path(__file__).parent.parent
PATHS = int(sys.argv[1]) if len(sys.argv) > 1 and sys.argv[1].isdigit() else 2
BLOCKS = 6
"""Number of blocks per path; the page is connected in half of them."""
SETTLE, BLOCK = 3.0, 4.5
"""Time after each change that is not measured, and time that is measured, s."""
LOADING = 6.0
"""Time for which a page that was just opened is not measured, s."""

# Counts the messages that reach the page, and can cut its connection: viser's socket is in a worker.
_COUNTER = """
window.came = {updates: [], pictures: 0};
window.cut = false;
window.Worker = class extends window.Worker {
  constructor(...how) {
    super(...how);
    window.wire = this;
    this.addEventListener('message', ({data}) => {
      if (data.type !== 'message_batch') return;
      const has = kind => data.messages.some(kind);
      const moved = m => m.type === 'SetPositionMessage' && m.name === '/robots/FR/tool0';
      if (has(moved)) came.updates.push(Date.now());
      if (has(m => m.type === 'GuiUpdateMessage' && '_data' in (m.updates || {}))) came.pictures += 1;
    });
  }
  postMessage(message, ...more) {
    if (window.cut && message.type === 'retry') return;
    if (message.type === 'set_server') window.server ??= message.server;
    super.postMessage(message, ...more);
  }
};
"""
_CUT = "window.cut = true; wire.postMessage({type: 'set_server', server: 'ws://127.0.0.1:1'});"
_JOIN = "window.cut = false; wire.postMessage({type: 'set_server', server: window.server});"


async def serve(parent: str, out: str) -> None:
    """Run the daemon of the demo, with a clock at its ticks, as a real-time process if allowed."""
    end_with(int(parent))
    set_priority(PRIORITIES["daemon"])
    ticks = []

    class Noted(Lateness):
        def note(self, late_ns: int, gap_ns: int) -> None:
            ticks.append((monotonic_ns(), late_ns))
            super().note(late_ns, gap_ns)

    overlay = Path(out).with_suffix(".yaml")
    overlay.write_text("armgate: 1\nserver: {port: 0}\n", encoding="utf-8")
    cell = build_cell(load_config([ROOT / "configs" / "demo.yaml", overlay]))
    daemon = Daemon(cell, Gate, Log(io.StringIO()))
    daemon._pace._clock.lateness = Noted()
    await daemon.run(lambda host, port: print(f"127.0.0.1:{port}", flush=True))
    await asyncio.to_thread(Path(out).write_text, json.dumps(ticks), encoding="utf-8")


@contextlib.contextmanager
def child(*command: str):
    """Run a process; yield the last word of its first line."""
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT)
    try:
        line = process.stdout.readline().split()
        if not line:
            sys.exit(f"{' '.join(command)} did not start: see above")
        yield line[-1]
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(30)


def armgate(priority: int, *arguments: str) -> list[str]:
    return [sys.executable, "-m", "armgate.apps.stack.child", str(os.getpid()), str(priority), *arguments]


@contextlib.contextmanager
def browser():
    sys.path.insert(0, str(ROOT / "tests"))
    from support.browsers import chromium

    with chromium() as made:
        tab = made.tab()
        tab.before_load(_COUNTER)
        yield tab


def measure(page) -> list[tuple[bool, int, int, float, dict]]:
    """Return blocks: connected or not, begin and end on the daemon's clock, length, messages."""
    blocks = []
    for number in range(BLOCKS):
        on = number % 2 == 1
        page.evaluate(_JOIN if on else _CUT)
        sleep(SETTLE)
        before, begin, start = page.evaluate("came"), monotonic_ns(), monotonic()
        sleep(BLOCK)
        end, length = monotonic_ns(), monotonic() - start
        after = page.evaluate("came")
        came = {
            "updates": after["updates"][len(before["updates"]) :],
            "pictures": after["pictures"] - before["pictures"],
        }
        blocks.append((on, begin, end, length, came))
    return blocks


def wait_for_work(address: str) -> None:
    """Wait until the follower is on the leader's tool: starting programs delay the robots' processes."""
    with connect(address, name="bench", role="observer") as cell:
        cell.subscribe(every=4, robots=["FR"], fields=["q"])
        for state in cell.states():
            error, progress = (state.signals.get(name) for name in ("follow.angle_error", "lead.progress"))
            if error and progress and progress.value[0] > 0.02 and error.value[0] < 0.02:
                return


def a_second(times: list[float]) -> float:
    """Return updates per second: the median of the seconds in which FR moves; at rest there are none."""
    counts = np.bincount(((np.array(times) - times[0]) / 1e3).astype(int))[:-1]
    return float(np.median(counts[counts > 0]))


def run(out: Path) -> list[tuple[bool, int, int, float, dict]]:
    blocks = []
    with (
        child(sys.executable, __file__, "serve", str(os.getpid()), str(out)) as address,
        child(*armgate(ORDINARY, "view", address, "--port", "0", "--no-meshes")) as url,
        browser() as page,
    ):
        page.open(url)
        sleep(LOADING)
        for _ in range(PATHS):
            programs = [
                subprocess.Popen(
                    armgate(PRIORITIES["controller"], *command), stdout=subprocess.DEVNULL, cwd=ROOT
                )
                for command in (
                    ("follow", address, "--robot", "FR", "--leader", "GR"),
                    ("lead", address, "--path", "configs/paths/inspection.csv"),
                )
            ]
            wait_for_work(address)
            blocks += measure(page)
            for program in programs:
                program.send_signal(signal.SIGINT)
                program.wait(30)
    return blocks


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "ticks.json"
        blocks = run(out)
        ticks = json.loads(out.read_text(encoding="utf-8"))
    late = {True: [], False: []}
    for on, begin, end, _, _ in blocks:
        late[on] += [late_ns / 1e6 for at, late_ns in ticks if begin <= at < end]
    seconds = sum(length for on, _, _, length, _ in blocks if on)
    pictures = sum(came["pictures"] for on, _, _, _, came in blocks if on) / seconds
    updates = float(np.median([a_second(came["updates"]) for on, _, _, _, came in blocks if on]))
    p99 = {on: float(np.percentile(late[on], 99)) for on in late}
    rows = [
        Row("one browser changes p99 lateness by", abs(p99[True] - p99[False]), "ms", 0.5),
        Row("updates that reach the page while FR moves", updates, "1/s", 29.0, at_least=True),
        Row("camera pictures that reach the page", pictures, "1/s", 10.0, at_least=True),
    ]
    for on, what in ((False, "not connected"), (True, "connected")):
        rows += [
            Row(f"lateness, page {what}: median", float(np.median(late[on])), "ms"),
            Row(f"lateness, page {what}: p99", p99[on], "ms"),
            Row(f"ticks, page {what}", len(late[on]), "1"),
        ]
    report("view", rows)


if __name__ == "__main__":
    if len(sys.argv) > 1 and sys.argv[1] == "serve":
        asyncio.run(serve(*sys.argv[2:]))
    else:
        main()
