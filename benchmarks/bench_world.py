"""Time of one step of the two-robot demo cell in one process, with its gate, without and with controllers.

Without controllers, a participant holds each robot. It moves one joint after the other back and forth, with
the same increments in every run, and receives all states. The shares of the parts of a step are measured in a
second run, with timers around them that slow it down.

With controllers, the programs of the demo run in the world: a leader that plays the inspection tour, and the
follower with its compiled law. At last the same programs run as processes, in lock-step over sockets, as
`bench_demo.py` does.

    bench_world.py [STEPS]
"""

import gc
import math
import sys
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from time import perf_counter_ns, process_time
from typing import Any
from unittest.mock import patch

import numpy as np
from bench_demo import rows as over_sockets
from report import Row, report
from scenes import CONFIGS, demo_cell

from armgate.apps.follow import program as follow
from armgate.apps.lead import drive as lead
from armgate.gate import Gate
from armgate.gate.decision import DecisionMaker
from armgate.gate.reservations import Reservations
from armgate.links.emulated.link import EmulatedLink
from armgate.programs import Controller, WorldRun
from armgate.protocol import messages as m
from armgate.world import World
from armgate.world.states import States

STEPS = int(sys.argv[1]) if len(sys.argv) > 1 else 4000
GOAL = 0.35
"""Goal for the median step, ms."""
PROGRAMS_GOAL = 25.0
"""Goal for the speed with leader and follower, × real time."""

WARM_UP = 300
COPIES = 20
PARTS: dict[str, tuple[type, str]] = {
    "ticks in the gate: nearest pairs": (Gate, "_update_nearest"),
    "ticks in the gate: all": (Gate, "_tick"),
    "commands in the gate: decision": (DecisionMaker, "decide"),
    "commands in the gate: all": (Gate, "_command"),
    "reserved positions": (Reservations, "reserve_held_plan"),
    "links and emulated robots": (EmulatedLink, "advance"),
    "states: content": (States, "put"),
    "states: sending": (States, "publish"),
}
"""Methods whose share of a step is measured; a part may contain another one."""


class Run:
    """World of the demo cell with a participant for each robot."""

    def __init__(self) -> None:
        cell = demo_cell()
        self.world = World(cell, [robot.name for robot in cell.robots])
        self.clients = {}
        for robot in cell.robots:
            client = self.world.join(robot.name)
            lease = client.request(m.Acquire(robot=robot.name))
            assert isinstance(lease, m.Lease)
            client.send(m.Subscribe())
            self.clients[robot.name] = client, lease.fence, (robot.velocity * robot.period).tolist()
        self.outcomes: dict[str, int] = {}

    def step(self) -> None:
        """Send a command for each robot, end the step, and take the messages."""
        number = self.world.number
        for robot, (client, fence, largest) in self.clients.items():
            dq = _increment(number, largest)
            client.send(m.Command(robot=robot, fence=fence, seq=number, tick=number, dq=dq))
        self.world.step()
        for client, _, _ in self.clients.values():
            for message in client.take():
                if isinstance(message, m.Verdict):
                    self.outcomes[message.outcome] = self.outcomes.get(message.outcome, 0) + 1

    def time(self, steps: int) -> np.ndarray:
        """Return the time of each of some steps, ms."""
        times = np.zeros(steps)
        for k in range(steps):
            begin = perf_counter_ns()
            self.step()
            times[k] = 1e-6 * (perf_counter_ns() - begin)
        return times


def _increment(number: int, largest: list[float]) -> tuple[float, ...]:
    """Return the increment of one joint, which swings back and forth and ends where it began."""
    turn, phase = divmod(number, 200)
    moved = turn % len(largest)
    size = 0.1 * largest[moved] * math.sin(2.0 * math.pi * phase / 200.0)
    return tuple([size if joint == moved else 0.0 for joint in range(len(largest))])


class Parts:
    """Timers around methods.

    Attributes:
        spent: Time spent in each part, ns.
    """

    def __init__(self) -> None:
        self.spent = dict.fromkeys(PARTS, 0)

    def around(self, stack: ExitStack) -> None:
        """Measure all parts until the stack is closed."""
        for name, (owner, method) in PARTS.items():
            stack.enter_context(patch.object(owner, method, self._timed(name, getattr(owner, method))))

    def _timed(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def timed(*arguments: Any, **options: Any) -> Any:
            begin = perf_counter_ns()
            try:
                return function(*arguments, **options)
            finally:
                self.spent[name] += perf_counter_ns() - begin

        return timed


def steps() -> list[Row]:
    """Return the time of a step."""
    run = Run()
    run.time(WARM_UP)
    begin = process_time()
    times = run.time(STEPS)
    processor = 1e3 * (process_time() - begin) / STEPS
    period = 1e3 * min(robot.period for robot in run.world.cell.robots)
    print(f"outcomes: {run.outcomes}")
    return [
        Row("a step, median", float(np.median(times)), "ms", GOAL),
        Row("a step, mean", float(times.mean()), "ms"),
        Row("a step, mean of processor time", processor, "ms"),
        Row("a step, p99", float(np.percentile(times, 99)), "ms"),
        Row("speed", period / float(times.mean()), "x real time"),
    ]


def programs() -> list[Row]:
    """Return the speed with leader and follower."""
    cell = demo_cell()
    own = {
        "leader": Controller(partial(lead.make, path=CONFIGS / "paths" / "inspection.csv"), "GR"),
        "follower": Controller(partial(follow.make, leader="GR"), "FR"),
    }
    run = WorldRun(World(cell, list(own)), own)
    for _ in range(WARM_UP):
        run.step()
    begin, started = process_time(), perf_counter_ns()
    done = sum(run.step() for _ in range(STEPS))
    wall, processor = 1e-9 * (perf_counter_ns() - started), process_time() - begin
    simulated = done * min(robot.period for robot in cell.robots)
    return [
        Row("leader and follower, speed", simulated / wall, "x real time", PROGRAMS_GOAL, at_least=True),
        Row("leader and follower, by processor time", simulated / processor, "x real time"),
        Row("leader and follower, a step by processor time", 1e3 * processor / done, "ms"),
    ]


def shares() -> list[Row]:
    """Return the share of each part of a step."""
    run, parts = Run(), Parts()
    run.time(WARM_UP)
    with ExitStack() as stack:
        parts.around(stack)
        whole = 1e6 * float(run.time(STEPS // 2).sum())
    return [Row(f"share: {name}", 100.0 * spent / whole, "%") for name, spent in parts.spent.items()]


def copies() -> list[Row]:
    """Return the cost of copies."""
    run = Run()
    run.time(WARM_UP)
    begin = perf_counter_ns()
    for _ in range(COPIES):
        run.world.fork()
    each = 1e-6 * (perf_counter_ns() - begin) / COPIES
    return [Row("a fork", each, "ms"), Row("a saved world", len(run.world.save()) / 1e3, "kB")]


if __name__ == "__main__":
    gc.freeze()
    report("world", [*steps(), *programs(), *shares(), *copies(), *over_sockets()])
