"""Records a gate's run and is killed, once for each case: FOLDER, and cases WHERE or NUMBER as arguments.

Prints for each case, as a line of JSON: its name, how it ended, and how many steps were surely flushed.
"""

import json
import os
import signal
import sys
from pathlib import Path

from armgate import events as e
from armgate.cell.cell import build_cell
from armgate.daemon.core.gate_runner import GateRunner
from armgate.daemon.recording.record_file import RecordFile
from armgate.daemon.recording.recorder import Recorder
from armgate.daemon.recording.start import header_of
from armgate.gate import Gate
from armgate.links.emulated.link import EmulatedLink
from support.cells import arms_config

START = "feed"
STEPS = 1200


class Death:
    """When and where the process kills itself; ``system_call`` n: in the middle of the n-th write."""

    def __init__(self, case, say):
        self.where = case
        self.say = say
        self.put = self.flushed = self.parts = 0
        self.ending = False
        writes = {"start": 1, "in_chunk": 6}
        self.writes = int(case) if case.isdigit() else writes.get(case, sys.maxsize)

    def now(self):
        os.write(self.say, str(self.flushed).encode())
        os.kill(os.getpid(), signal.SIGKILL)

    def write(self, descriptor, data):
        self.writes -= 1
        if self.writes <= 0:
            os.write(descriptor, data[: len(data) * 2 // 3])
            self.now()
        return os.write(descriptor, data)


def mortal(death):
    """A file in which one dies."""

    class Mortal(RecordFile):
        @classmethod
        def create(cls, path, header, _signer):
            death.parts += 1
            if death.where == "turn_closed" and death.parts == 3:
                death.now()
            descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644)
            if death.where == "turn_begun" and death.parts == 3:
                death.writes = 1
            return cls(path, descriptor, header, death.write)

        def put(self, item, at):
            super().put(item, at)
            death.put += 1
            if death.where == "between" and death.put == 300:
                death.now()

        def flush(self):
            super().flush()
            death.flushed = death.put
            if death.where == "after_chunk" and death.put >= 300:
                death.now()

        def close(self, **how):
            self.flush()
            if death.where == "closing" and death.ending:
                death.writes = 1
            return super().close(**how)

    return Mortal.create


LIMIT = 1 << 30  # all that is fed has room: it is fed faster than any robot ticks


def record(cell, folder, case, say):
    death = Death(case, say)
    recorder = Recorder(folder, rotate=150_000, flush=0.0, limit=LIMIT, create=mortal(death))
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
    death.ending = True
    recorder.close()


def case(cell, folder, name):
    ear, say = os.pipe()
    child = os.fork()
    if child == 0:
        record(cell, folder / name, name, say)
        os._exit(0)
    os.close(say)
    _, status = os.waitpid(child, 0)
    said = os.read(ear, 100)
    os.close(ear)
    return {"case": name, "status": os.waitstatus_to_exitcode(status), "flushed": int(said or b"-1")}


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    cell = build_cell(arms_config(folder))
    for name in sys.argv[2:]:
        sys.stdout.write(json.dumps(case(cell, folder, name)) + "\n")
        sys.stdout.flush()
