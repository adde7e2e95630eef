"""A core with a real gate and emulated arms, and clients that are lists."""

import io

from armgate.cell.cell import build_cell
from armgate.daemon.core.core import Core
from armgate.daemon.core.gate_runner import GateRunner
from armgate.gate import Gate
from armgate.links.emulated import EmulatedLink
from armgate.links.log import Log
from armgate.protocol import messages as m


class Peer:
    """A client whose messages are kept."""

    def __init__(self, id_, name, role="controller", capabilities=()):
        self.id, self.name, self.role = id_, name, role
        self.capabilities = frozenset(capabilities)
        self.identity, self.token_name, self.address = "here", None, "127.0.0.1:4711"
        self.known_as = None
        self.robots = self.subscription = None
        self.heard = []
        self.ended = False
        self.holds = 0

    def hold(self):
        self.holds += 1

    def let_go(self):
        self.holds -= 1

    def flush(self):
        pass

    def drop_states(self):
        pass

    def say(self, message, frame=None):
        self.heard.append(message)

    def show(self, *states):
        self.heard += [state.state for state in states]

    def expel(self, error):
        self.end(error.message())

    def end(self, message):
        self.say(message)
        self.ended = True

    def take(self, model=None):
        """All messages so far (of a model); they are not given again."""
        found = [x for x in self.heard if model is None or isinstance(x, model)]
        self.heard = [x for x in self.heard if x not in found]
        return found

    def last(self, model):
        """The one message of this model since the last time."""
        (found,) = self.take(model)
        return found


class Time:
    """Daemon time, to be set."""

    def __init__(self):
        self.now = 0.0

    def __call__(self):
        return self.now


class Bench:
    """A core, its time, and clients."""

    def __init__(self, config, lockstep=False, judge=None, defer=None):
        self.cell = build_cell(config)
        self.log = io.StringIO()
        self.time = Time()
        links = [
            EmulatedLink(robot.name, "d1", robot.start.tolist(), robot.period, robot.config.link.lag)
            for robot in self.cell.robots
        ]
        self.gate = Gate(self.cell, "d1") if judge is None else judge
        self.events = []
        runner = GateRunner(self.gate, {link.robot: link for link in links}, self._tap)
        self.core = Core(self.cell, runner, links, self.time, lockstep, Log(self.log), defer=defer)
        self.count = 0

    def _tap(self, event, outputs):
        self.events.append((event, outputs))

    def start(self):
        self.core.start()
        self.core.tick(0.0, range(len(self.cell.robots)))
        return self

    def tick(self, count=1):
        """Let all robots tick."""
        for _ in range(count):
            self.time.now += self.cell.robots[0].period
            self.core.tick(self.time.now, range(len(self.cell.robots)))

    def client(self, name, role="controller"):
        self.count += 1
        peer = Peer(f"s{self.count}", name, role)
        self.core.join(peer)
        return peer

    def holder(self, name, robot, **acquire):
        """A client that holds a robot; its fence."""
        peer = self.client(name)
        self.core.handle(peer, m.Acquire(robot=robot, **acquire))
        return peer, peer.last(m.Lease).fence

    def command(self, peer, robot, fence, seq, dq=(0.001, 0.0, 0.0), tick=None):
        """Send a command; the messages that answer it."""
        tick = self.core._runner.view(robot).tick if tick is None else tick
        self.core.handle(peer, m.Command(robot=robot, fence=fence, seq=seq, tick=tick, dq=dq))
        return peer.take()
