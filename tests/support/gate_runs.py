"""Recorded runs of a gate without a daemon: what is asked for at each tick is a function of the tick."""

from armgate import events as e
from armgate.daemon.core.gate_runner import GateRunner
from armgate.daemon.recording.recorder import Recorder
from armgate.daemon.recording.start import header_of
from armgate.gate import Gate
from armgate.links.emulated.link import EmulatedLink

START = "feed"
LIMIT = 1 << 30  # all that is fed has room: it is fed faster than any robot ticks


def record_run(cell, folder, ticks, ask, recorder=None, lag=0.03):
    """Records ``ticks`` instants; ``ask(k)`` gives each robot's increment by name, or none."""
    recorder = recorder or Recorder(folder, limit=LIMIT)
    time = 0.0
    recorder.begin(header_of(cell, START, False, 0.0, compiled=False), lambda: time)
    links = [EmulatedLink(r.name, START, r.start.tolist(), r.period, lag) for r in cell.robots]
    runner = GateRunner(Gate(cell, START, compiled=False), {link.robot: link for link in links}, recorder.tap)
    for fence, link in enumerate(links, start=1):
        runner.feed(e.LinkChange(link.robot, e.LinkState.READY))
        runner.feed(e.LeaseChange(link.robot, fence))
    for k in range(ticks):
        time = cell.robots[0].period * k
        for link in links:
            runner.feed(link.advance(time))
        for fence, link in enumerate(links, start=1):
            dq = ask(k).get(link.robot)
            if dq is not None:
                runner.feed(e.Command(link.robot, fence, k, k, tuple(dq)))
    return recorder
