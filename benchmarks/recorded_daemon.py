"""``armgate serve …`` that measures the cost of recording in its event loop and writes it to $FIGURES."""

import json
import os
import sys
from time import perf_counter

from armgate.apps.stack.child import end_with, set_priority
from armgate.apps.stack.plan import PRIORITIES
from armgate.daemon.recording import recorder, start

spent: dict[str, list[float]] = {"tick": [], "command": [], "answer": [], "state": [], "append": []}
_KINDS = {"Tick": "tick", "Command": "command", "PlanAnswer": "answer"}


class Timed(recorder.Recorder):
    def tap(self, event, outputs):
        start = perf_counter()
        super().tap(event, outputs)
        end = perf_counter()
        kind = _KINDS.get(type(event).__name__)
        if kind:
            spent[kind].append(end - start)
        row = []
        start = perf_counter()  # the unit: the smallest possible cost of recording
        row.append((event, outputs))
        spent["append"].append(perf_counter() - start)

    def show(self, snapshot):
        start = perf_counter()
        super().show(snapshot)
        if snapshot.ticks:
            spent["state"].append((perf_counter() - start) / len(snapshot.ticks))

    def close(self, timeout=10.0):
        super().close(timeout)
        with open(os.environ["FIGURES"], "w", encoding="utf-8") as file:
            json.dump({"spent": spent, "lost": self.lost}, file)


if __name__ == "__main__":
    from armgate.apps.cli import main

    start.Recorder = Timed
    end_with(int(sys.argv[1]))
    set_priority(PRIORITIES["daemon"])
    main(sys.argv[2:])
