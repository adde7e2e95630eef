"""Speed of the whole stack in lock-step: daemon, leader, follower and observer as processes.

The demo as a user starts it, with its recording, without the viewer. The result is the wall-clock time per
second of the run, from the second state to the last, without starting processes and drawing pictures, and the
processor time of each process in a step.

    bench_demo.py [SECONDS]
"""

import json
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic, sleep

from report import Row, report

SECONDS = 30.0
GOAL = 8.0
"""Goal for the speed, × real time."""

_STEP = 12.0
"""Period of the demo's robots, ms."""
_SAMPLED = 0.25
"""Time between two samples of the processor time, s."""
_PROCESSES = {"serve": "daemon", "lead": "leader", "follow": "follower"}
"""Processes of the demo by their command; the demo itself is the observer."""


@dataclass
class ProcessorTimes:
    """Processor times of the demo and its children while it runs.

    Attributes:
        samples: Time, and processor time by process, s.
    """

    demo: int
    names: dict[int, str] = field(default_factory=dict)
    samples: list[tuple[float, dict[str, float]]] = field(default_factory=list)

    def sample(self) -> None:
        """Take a sample, if both controllers run."""
        for pid in _children(self.demo):
            if pid not in self.names:
                self.names[pid] = _PROCESSES.get(_command(pid), "")
        now = {name: _processor_time(pid) for pid, name in self.names.items() if name}
        now["observer"] = _processor_time(self.demo)
        if now.get("leader") and now.get("follower"):
            self.samples.append((monotonic(), now))

    def shares(self, wall: float) -> dict[str, float]:
        """Return the processor time per second of each process, in the middle of a run of ``wall`` s."""
        end = self.samples[-1][0]
        inside = [sample for sample in self.samples if end - 0.8 * wall <= sample[0] <= end - 0.1 * wall]
        (begin, first), (end, last) = inside[0], inside[-1]
        return {name: (last[name] - first[name]) / (end - begin) for name in first}


def _children(pid: int) -> list[int]:
    try:
        return [
            int(child)
            for task in Path(f"/proc/{pid}/task").iterdir()
            for child in (task / "children").read_text().split()
        ]
    except OSError:
        return []


def _command(pid: int) -> str:
    """Return the armgate command of a child of the demo: its arguments are ``… PID PRIORITY COMMAND …``."""
    try:
        words = Path(f"/proc/{pid}/cmdline").read_text().split("\0")
    except OSError:
        return ""
    return next((word for word in words if word in _PROCESSES), "")


def _processor_time(pid: int) -> float:
    """Return the processor time of all threads of a process, s; 0 once it has ended."""
    try:
        tasks = [(task / "schedstat").read_text() for task in Path(f"/proc/{pid}/task").iterdir()]
    except OSError:
        return 0.0
    return 1e-9 * sum(int(text.split()[0]) for text in tasks)


def rows(seconds: float = SECONDS) -> list[Row]:
    """Run the demo, and return its speed and the processor time of each process."""
    command = [sys.executable, "-m", "armgate.apps", "demo", "--lockstep", "--no-view", "--no-monitor"]
    with TemporaryDirectory(prefix="armgate-") as folder:
        run = subprocess.Popen(
            [*command, "--duration", str(seconds), "--out", folder], stdout=subprocess.DEVNULL
        )
        times = ProcessorTimes(run.pid)
        while run.poll() is None:
            times.sample()
            sleep(_SAMPLED)
        if run.returncode:
            raise SystemExit(f"the demo failed with status {run.returncode}")
        metrics = json.loads((Path(folder) / "metrics.json").read_text())
    return _rows(metrics["realtime_factor"], times.shares(metrics["duration_s"] / metrics["realtime_factor"]))


def _rows(pace: float, shares: dict[str, float]) -> list[Row]:
    step = _STEP / pace
    spent = [
        Row(f"over sockets: {name}, a step by processor time", step * share, "ms")
        for name, share in shares.items()
    ]
    return [
        Row("lock-step over sockets: speed", pace, "x real time", GOAL, at_least=True),
        Row("over sockets: a step", step, "ms"),
        *spent,
        Row("over sockets: use of two cores", 50.0 * sum(shares.values()), "%"),
    ]


if __name__ == "__main__":
    report("demo", rows(float(sys.argv[1]) if len(sys.argv) > 1 else SECONDS))
