"""Core with a real gate and emulated arms, and clients that keep their messages in lists."""

import io
from dataclasses import replace

from armgate.cell.cell import build_cell
from armgate.gate import Gate
from armgate.links.emulated.link import EmulatedLink
from armgate.links.log import Log
from armgate.protocol import messages as m
from armgate.world.core import Core
from armgate.world.gate_runner import GateRunner
from armgate.world.interfaces import Client
from armgate.world.lease_changes import LeaseTime


class Peer:
    """Client that keeps all messages that it receives."""

    def __init__(self, id_, name, role="controller"):
        self.client = Client(id_, name, role, identity="here", address="127.0.0.1:4711")
        self.received = []
        self.ended = False
        self.batches = 0

    def change(self, **fields):
        """Change the name, role or identity of the client."""
        self.client = replace(self.client, **fields)

    def batch(self):
        self.batches += 1
        return Batch(self)

    def keep_states(self):
        pass

    def drop_states(self):
        pass

    def send(self, message, frame=None):
        self.received.append(message)

    def send_states(self, *states):
        self.received += [state.state for state in states]

    def expel(self, error):
        self.close(error.message())

    def close(self, message):
        self.send(message)
        self.ended = True

    def take(self, model=None):
        """Remove and return all messages so far, or those of a model."""
        found = [x for x in self.received if model is None or isinstance(x, model)]
        self.received = [x for x in self.received if x not in found]
        return found

    def last(self, model):
        """Remove and return the only message of this model."""
        (found,) = self.take(model)
        return found


class Batch:
    """An open batch of a peer, which counts them."""

    def __init__(self, peer):
        self.peer = peer

    def close(self):
        self.peer.batches -= 1

    def flush(self):
        pass


class Time:
    """Clock of the daemon, which tests set."""

    def __init__(self):
        self.now = 0.0

    def __call__(self):
        return self.now


class Bench:
    """A core, its time, and clients."""

    def __init__(self, config, lockstep=False, gate=None, defer=None, now=None):
        self.cell = build_cell(config)
        self.log = io.StringIO()
        self.time = Time()
        self.links = [
            EmulatedLink(robot.name, "d1", robot.start.tolist(), robot.period, robot.config.link.lag)
            for robot in self.cell.robots
        ]
        self.gate = Gate(self.cell, "d1") if gate is None else gate
        self.events = []
        runner = GateRunner(self.gate, {link.robot: link for link in self.links}, self._tap)
        self.core = Core(
            self.cell,
            runner,
            self.links,
            now or self.time,
            Log(self.log),
            lockstep=lockstep,
            lease_time=(lambda: LeaseTime(0.0, 0.0)) if lockstep else None,
            defer=defer,
        )
        self.count = 0

    def _tap(self, event, outputs):
        self.events.append((event, outputs))

    def start(self):
        self.core.start()
        self.due(0.0, range(len(self.links)))
        return self

    def due(self, time, robots, step=None):
        """Let some robots tick."""
        self.core.tick([self.links[index].advance(time) for index in robots], step)

    def tick(self, count=1):
        """Let all robots tick."""
        for _ in range(count):
            self.time.now += self.cell.robots[0].period
            self.due(self.time.now, range(len(self.links)))

    def last(self, robot):
        """Return the last tick of a robot."""
        return self.core._motion.ticks[robot]

    def client(self, name, role="controller"):
        self.count += 1
        peer = Peer(f"s{self.count}", name, role)
        self.core.join(peer)
        return peer

    def holder(self, name, robot, **acquire):
        """Return a client with a lease of a robot, and the fence."""
        peer = self.client(name)
        self.core.handle(peer, m.Acquire(robot=robot, **acquire))
        return peer, peer.last(m.Lease).fence

    def command(self, peer, robot, fence, seq, dq=(0.001, 0.0, 0.0), tick=None):
        """Send a command; return the messages that answer it."""
        tick = self.gate.view(robot).tick if tick is None else tick
        self.core.handle(peer, m.Command(robot=robot, fence=fence, seq=seq, tick=tick, dq=dq))
        return peer.take()
