"""Recorded runs of a gate without a daemon: the commands are a function of the tick."""

from armgate import events as e
from armgate.daemon.recording.recorder import Recorder
from armgate.gate import Gate
from armgate.links.emulated.link import EmulatedLink
from armgate.recorder.header import header_of
from armgate.world.gate_runner import GateRunner

START = "feed"
LIMIT = 1 << 30  # unlimited in effect: the events arrive much faster than in real time


def record_run(cell, folder, ticks, ask, recorder=None, lag=0.03):
    """Record ``ticks`` ticks; ``ask(k)`` returns increments by robot, None or no entry for no command."""
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
