"""Speed of the whole stack in lock-step: daemon, leader, follower and observer as processes.

The demo as a user starts it, with its recording, without the viewer. The result is the wall-clock time per
second of the run, from the first state to the last, without starting processes and drawing pictures.
"""

import json
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from report import Row, report

SECONDS = float(sys.argv[1]) if len(sys.argv) > 1 else 30.0
GOAL = 0.125  # s per second of the run: eight times real time


def main() -> None:
    command = [sys.executable, "-m", "armgate.apps", "demo", "--lockstep", "--no-view"]
    with TemporaryDirectory(prefix="armgate-") as folder:
        run = [*command, "--duration", str(SECONDS), "--out", folder]
        subprocess.run(run, check=True, stdout=subprocess.DEVNULL)
        metrics = json.loads((Path(folder) / "metrics.json").read_text())
    pace = metrics["realtime_factor"]
    ticks = metrics["ticks"]["FR"]
    report(
        "demo",
        [
            Row("lock-step, a second of the run", 1.0 / pace, "s", GOAL),
            Row("lock-step, pace", pace, "× real time"),
            Row("lock-step, a tick of all", 1e3 * metrics["duration_s"] / pace / ticks, "ms"),
        ],
    )


if __name__ == "__main__":
    main()
