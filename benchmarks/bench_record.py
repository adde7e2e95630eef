"""Cost of recording in the demo: time of the daemon's loop per robot tick, and disk space per hour.

The demo runs by the wall clock: daemon, leader, follower. The daemon's recorder is timed in its own loop; the
unit is an append to a list, measured at the same places.
"""

import json
import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median

import numpy as np
from report import Row, report

from armgate.apps.default_files import default_file
from armgate.recording import Recording

HOUR = 3600.0
GOALS = {0.012: 350.0, 0.004: 1000.0}
LOOP_GOAL = 50.0


def start(*command):
    """Run a child process, and read its first line."""
    return subprocess.Popen([sys.executable, *map(str, command)], stdout=subprocess.PIPE, text=True)


def measure(period, seconds, folder):
    """Return the recorder's times by kind [s], lost records, MB per hour, ms between two chunks."""
    overlay = folder / "period.yaml"
    robots = "".join(f"  {name}: {{period: {period}}}\n" for name in ("FR", "GR"))
    overlay.write_text(f"robots:\n{robots}", encoding="utf-8")
    os.environ["FIGURES"] = str(folder / "figures.json")
    own = [default_file("demo.yaml"), overlay, "--port", 0, "--record", folder / "run"]
    daemon = start(Path(__file__).with_name("recorded_daemon.py"), os.getpid(), "serve", *own)
    address = daemon.stdout.readline().split()[-1]
    app = ("-m", "armgate.apps")
    lead = ("--path", default_file("paths/inspection.csv"), "--duration", seconds)
    follower = start(*app, "follow", address, "--robot", "FR", "--leader", "GR", "--lag", 0.03)
    leader = start(*app, "lead", address, "--robot", "GR", *lead)
    leader.communicate()
    for child, number in ((follower, signal.SIGINT), (daemon, signal.SIGTERM)):
        child.send_signal(number)
        child.communicate()
    figures = json.loads((folder / "figures.json").read_text(encoding="utf-8"))
    places = [place for part in Recording.open(folder / "run").parts for place in part.chunks][1:]
    file = places[0].file
    # From the first chunk after the header to the end of the last: chunks and the indexes between them.
    size = places[-1].offset + places[-1].length - places[0].offset
    lasted = (places[-1].last_ns - places[0].first_ns) / 1e9
    gap = median(np.diff([place.last_ns for place in places])) / 1e6
    assert len({place.file for place in places}) == 1, file
    return figures["spent"], figures["lost"], size * HOUR / lasted / 1e6, gap


def rows(period, seconds):
    """Return the figures of one period."""
    with tempfile.TemporaryDirectory() as folder:
        spent, lost, per_hour, gap = measure(period, seconds, Path(folder))
    ms = f"{1000 * period:g} ms"
    us = {kind: 1e6 * np.array(times) for kind, times in spent.items()}
    # A robot tick costs a tick, a command, the link's answer to its plan, and a share of the state.
    total = sum(float(np.median(us[kind])) for kind in ("tick", "command", "answer", "state"))
    late = sum(float(np.percentile(us[kind], 99)) for kind in ("tick", "command", "answer", "state"))
    unit = float(np.median(us["append"]))
    return [
        Row(f"{ms}: loop per robot tick, median", total, "µs", LOOP_GOAL),
        Row(f"{ms}: the same, p99 of each part", late, "µs"),
        Row(f"{ms}: the same, in appends to a list", total / unit, "×"),
        Row(f"{ms}: an hour of the demo", float(per_hour), "MB", GOALS[period]),
        Row(f"{ms}: between two flushes, median", float(gap), "ms", 200.0),
        Row(f"{ms}: records lost", lost, "1", 0.0),
    ]


if __name__ == "__main__":
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 50.0
    report("record", [row for period in GOALS for row in rows(period, seconds)])
