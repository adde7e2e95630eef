"""Process that records a run of a gate and kills itself: ``python killed_recorder.py FOLDER CASE…``.

A case is the name of a place in the code, or the number of the write that is cut short. Each case runs in a
child process. A line of JSON per case states its name, its exit status, and the number of flushed steps.
"""

import json
import os
import signal
import sys
from pathlib import Path

from armgate import events as e
from armgate.cell.cell import build_cell
from armgate.daemon.recording.recorder import Recorder
from armgate.gate import Gate
from armgate.links.emulated.link import EmulatedLink
from armgate.recorder.header import header_of
from armgate.recorder.record_file import DiskCalls, RecordFile
from armgate.world.gate_runner import GateRunner
from support.cells import arms_config

START = "feed"
STEPS = 1200


class Kill:
    """Place in the code where the process kills itself; a number n: in the middle of the n-th write."""

    def __init__(self, case, report):
        self.where = case
        self.report = report
        self.put = self.flushed = self.parts = 0
        self.ending = False
        writes = {"start": 1, "in_chunk": 6}
        self.writes = int(case) if case.isdigit() else writes.get(case, sys.maxsize)

    def now(self):
        os.write(self.report, str(self.flushed).encode())
        os.kill(os.getpid(), signal.SIGKILL)

    def write(self, descriptor, data):
        self.writes -= 1
        if self.writes <= 0:
            os.write(descriptor, data[: len(data) * 2 // 3])
            self.now()
        return os.write(descriptor, data)


def killing_file(kill):
    """Return the constructor of a recording file that kills the process."""

    class KillingFile(RecordFile):
        @classmethod
        def create(cls, path, header, _signer):
            kill.parts += 1
            if kill.where == "turn_closed" and kill.parts == 3:
                kill.now()
            descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644)
            if kill.where == "turn_begun" and kill.parts == 3:
                kill.writes = 1
            return cls(path, descriptor, header, DiskCalls(kill.write))

        def put(self, item, at):
            super().put(item, at)
            kill.put += 1
            if kill.where == "between" and kill.put == 300:
                kill.now()

        def flush(self):
            super().flush()
            kill.flushed = kill.put
            if kill.where == "after_chunk" and kill.put >= 300:
                kill.now()

        def close(self, **how):
            self.flush()
            if kill.where == "closing" and kill.ending:
                kill.writes = 1
            return super().close(**how)

    return KillingFile.create


LIMIT = 1 << 30  # unlimited in effect: the events arrive much faster than in real time


def record(cell, folder, case, report):
    kill = Kill(case, report)
    recorder = Recorder(folder, rotate=150_000, flush=0.0, limit=LIMIT, create=killing_file(kill))
    time = 0.0
    recorder.begin(header_of(cell, START, False, 0.0, compiled=False), lambda: time)
    links = [EmulatedLink(r.name, START, r.start.tolist(), r.period, 0.03) for r in cell.robots]
    runner = GateRunner(Gate(cell, START, compiled=False), {link.robot: link for link in links}, recorder.tap)
    for link in links:
        runner.feed(e.LinkChange(link.robot, e.LinkState.READY))
    runner.feed(e.LeaseChange("A", 1))
    for k in range(STEPS // 4):
        time = 0.012 * k
        for link in links:
            runner.feed(link.advance(time))
        way = 0.0005 if k // 40 % 2 == 0 else -0.0005
        runner.feed(e.Command("A", 1, k, k, (way, 0.0, 0.0)))
    kill.ending = True
    recorder.close()


def case(cell, folder, name):
    reader, report = os.pipe()
    child = os.fork()
    if child == 0:
        record(cell, folder / name, name, report)
        os._exit(0)
    os.close(report)
    _, status = os.waitpid(child, 0)
    flushed = os.read(reader, 100)
    os.close(reader)
    return {"case": name, "status": os.waitstatus_to_exitcode(status), "flushed": int(flushed or b"-1")}


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    cell = build_cell(arms_config(folder))
    for name in sys.argv[2:]:
        sys.stdout.write(json.dumps(case(cell, folder, name)) + "\n")
        sys.stdout.flush()
