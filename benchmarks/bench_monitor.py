"""Benchmark of the monitor: its share of a core in the demo, and its effect on the lateness of ticks.

Usage: bench_monitor.py [SECONDS]. The demo runs by the wall clock, with and without the monitor in turn. The
lateness of ticks comes from the daemon's histogram, read while the demo runs. A check of the recording
follows.
"""

import json
import re
import subprocess
import sys
import time
import urllib.request
from pathlib import Path
from tempfile import TemporaryDirectory

from report import Row, report

SECONDS = float(sys.argv[1]) if len(sys.argv) > 1 else 15.0
ROUNDS = 2
"""Number of runs with and without the monitor; the smallest lateness counts: other programs only add."""

PORT = 7493
BUCKET = re.compile(r'^armgate_tick_lateness_seconds_bucket\{.*le="([^"]+)".*\} (\S+)$', re.MULTILINE)


def scrape() -> dict[float, float]:
    """Return the number of ticks by upper bound of their lateness, s; empty before the port is served."""
    try:
        with urllib.request.urlopen(f"http://127.0.0.1:{PORT}/metrics", timeout=1.0) as page:
            text = page.read().decode()
    except OSError:
        return {}
    counts: dict[float, float] = {}
    for bound, count in BUCKET.findall(text):
        counts[float(bound)] = counts.get(float(bound), 0.0) + float(count)
    return counts


def quantile(counts: dict[float, float], share: float) -> float:
    """Return the lateness, ms, below which this share of the ticks is, interpolated between two bounds."""
    total, below, before = max(counts.values()), 0.0, 0.0
    for bound, count in sorted(counts.items()):
        if count >= share * total:
            inside = (share * total - below) / max(count - below, 1.0)
            return 1e3 * (before + inside * ((before if bound == float("inf") else bound) - before))
        before, below = bound, count
    return 1e3 * before


def demo(folder: Path, *options: str) -> tuple[dict, dict[float, float]]:
    """Run a demo in a new folder; return its figures and the lateness of its ticks."""
    folder.mkdir()
    overlay = folder / "metrics.yaml"
    overlay.write_text(f"armgate: 1\nmetrics: {{port: {PORT}}}\n", encoding="utf-8")
    command = [sys.executable, "-m", "armgate.apps", "demo", "--no-view", "--links", str(overlay)]
    command += ["--duration", str(SECONDS), "--out", str(folder / "run"), *options]
    counts: dict[float, float] = {}
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as child:
        while child.poll() is None:
            counts = scrape() or counts
            time.sleep(0.5)
    if child.returncode:
        sys.exit("the demo failed: see above")
    return json.loads((folder / "run" / "metrics.json").read_text(encoding="utf-8")), counts


def main() -> None:
    late: dict[bool, list[float]] = {True: [], False: []}
    with TemporaryDirectory(prefix="armgate-") as name:
        folder = Path(name)
        for turn in range(ROUNDS):
            _, counts = demo(folder / f"without{turn}", "--no-monitor")
            late[False].append(quantile(counts, 0.99))
            metrics, counts = demo(folder / f"with{turn}")
            late[True].append(quantile(counts, 0.99))
        run = folder / f"with{ROUNDS - 1}" / "run"
        audited = json.loads((run / "monitor.json").read_text(encoding="utf-8"))
        start = time.perf_counter()
        check = [sys.executable, "-m", "armgate.apps", "monitor", str(run)]
        subprocess.run(check, check=True, stdout=subprocess.DEVNULL)
        checked = time.perf_counter() - start
    with_, without = min(late[True]), min(late[False])
    report(
        "monitor",
        [
            Row("demo by the clock, share of a core", 100.0 * audited["share"], "%", 20.0),
            Row("demo by the clock, violations", audited["violations"], "1", 0.0),
            Row("demo by the clock, states missed", sum(audited["missed"].values()), "1", 0.0),
            Row("demo by the clock, states checked", audited["states"], "1"),
            Row("p99 of the ticks' lateness, increase by the monitor", with_ - without, "ms", 0.5),
            Row("p99 of the ticks' lateness, with the monitor", with_, "ms"),
            Row("p99 of the ticks' lateness, without it", without, "ms"),
            Row("late commands, with the monitor", metrics["late_commands"], "1", 0.0),
            Row("check of the recording, per state", 1e3 * checked / audited["states"], "ms"),
        ],
    )


if __name__ == "__main__":
    main()
