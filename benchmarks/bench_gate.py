"""What a decision of the gate costs, in units of one bare ``pin.computeDistances`` over the same pairs.

The unit is measured in the same process, interleaved with the decisions. A control (the
same clock read twice around nothing) stands beside each figure for the machine's noise.
"""

import sys
from time import perf_counter_ns

import numpy as np
import pinocchio as pin
from report import Row, report
from scenes import crowded_cell, demo_cell, six_robots

from armgate.cell.cell import Cell
from armgate.cell.events import Command, LeaseChange, LinkChange, LinkState, Plan, PlanAnswer, Tick
from armgate.integrity import Gate
from armgate.integrity.engine import CoalEngine

DECISIONS = int(sys.argv[1]) if len(sys.argv) > 1 else 4000
GLIDING_AT = 0.051
"""Distance from the floor while gliding, 1 mm above the stop distance, m."""

GOALS = {  # case: (median, p99) in units
    "demo, free": (1.5, 12.0),
    "demo, gliding": (5.0, 15.0),
    "demo + 1000 obstacles": (0.1, 0.3),
    "6 robots": (0.05, 0.4),
}


class Unit:
    """All pairs of a cell in one pinocchio geometry model: one C++ loop over them."""

    def __init__(self, cell: Cell) -> None:
        self.model = pin.Model()
        self.geometry = pin.GeometryModel()
        engine = CoalEngine(tuple(b.shape for b in cell.bodies))
        for body, shape in zip(cell.bodies, engine._shapes, strict=True):
            placement = pin.SE3.Identity()
            self.geometry.addGeometryObject(pin.GeometryObject(body.name, 0, placement, shape))
        for pair in cell.pairs:
            self.geometry.addCollisionPair(pin.CollisionPair(pair.a, pair.b))
        self.data = self.geometry.createData()
        self.cell = cell

    def place(self, positions: list[np.ndarray]) -> None:
        k = 0
        for robot, q in zip(self.cell.robots, positions, strict=True):
            R, t = robot.model.body_placements(q)
            for i in range(len(t)):
                self.data.oMg[k] = pin.SE3(np.array(R[i]), np.array(t[i]))
                k += 1
        for body in self.cell.surroundings:
            self.data.oMg[k] = pin.SE3(np.array(body.placement.R), np.array(body.placement.t))
            k += 1

    def measure(self) -> int:
        begin = perf_counter_ns()
        pin.computeDistances(self.geometry, self.data)
        return perf_counter_ns() - begin


class Rig:
    """Drives all robots of a cell through a gate with ideal links in virtual time."""

    def __init__(self, cell: Cell) -> None:
        self.cell, self.gate = cell, Gate(cell, "bench")
        self.setpoint = [tuple(float(x) for x in r.start) for r in cell.robots]
        self.plan: list[tuple[Plan, int] | None] = [None] * len(cell.robots)
        self.tick, self.refused, self.asked = 0, 0, 0
        for robot, q in zip(cell.robots, self.setpoint, strict=True):
            self.gate.step(LinkChange(robot.name, LinkState.READY))
            self.gate.step(LeaseChange(robot.name, 1))
            self.gate.step(Tick(robot.name, 0, 0.0, q, q, (0.0,) * robot.model.n))

    def decide(self, robot: int, dq: np.ndarray) -> int:
        """Sends one command; returns the ns of the decision."""
        name = self.cell.robots[robot].name
        command = Command(name, 1, self.asked, self.tick, tuple(float(x) for x in dq))
        begin = perf_counter_ns()
        out = self.gate.step(command)
        spent = perf_counter_ns() - begin
        self.asked += 1
        self.refused += len(out) == 1
        if len(out) == 2:
            self.plan[robot] = (out[1], -1)
            self.gate.step(PlanAnswer(name, out[1].key, True))
        return spent

    def advance(self) -> None:
        self.tick += 1
        for i, robot in enumerate(self.cell.robots):
            q, u, key, index = self.setpoint[i], (0.0,) * robot.model.n, None, -1
            held = self.plan[i]
            if held is not None and held[1] + 1 < len(held[0].increments):
                key, index = held[0].key, held[1] + 1
                u = held[0].increments[index]
                self.plan[i] = (held[0], index)
            self.setpoint[i] = tuple(a + b for a, b in zip(q, u, strict=True))
            now = self.tick * robot.period
            self.gate.step(Tick(robot.name, self.tick, now, q, self.setpoint[i], u, key, index))


def wander(rig: Rig, speed: float, spread: float) -> "list[np.ndarray]":
    """Smooth wandering of every robot around its start: sines of its own per joint."""
    rng = np.random.default_rng(3)
    waves = [(rng.uniform(0.2, 0.5, r.model.n), rng.uniform(0, 6.3, r.model.n)) for r in rig.cell.robots]

    def wishes() -> list[np.ndarray]:
        t, T = rig.tick * rig.cell.robots[0].period, rig.cell.robots[0].period
        out = []
        for robot, (f, phase) in zip(rig.cell.robots, waves, strict=True):
            amplitude = np.minimum(speed * robot.velocity, spread * 2 * np.pi * f)
            out.append(amplitude * T * np.sin(2 * np.pi * f * t + phase) * np.minimum(1.0, t / 1.0))
        return out

    return wishes


def glide(rig: Rig):
    """FR lowers its camera to just above the stop distance from the floor and sweeps there at 10 % speed."""
    robot = rig.cell.robots[0]

    def wishes() -> list[np.ndarray]:
        t, T = rig.tick * robot.period, robot.period
        near = min(n.distance for n in rig.gate.view(robot.name).nearest if n.limit > 0.03)
        v = np.zeros(robot.model.n)
        v[1] = np.clip(2.0 * (near - GLIDING_AT), -0.1 * robot.velocity[1], 0.1 * robot.velocity[1])
        v[0] = 0.1 * robot.velocity[0] * np.sin(0.6 * t)
        return [v * T, np.zeros(rig.cell.robots[1].model.n)]

    return wishes


def case(name: str, cell: Cell, drive, warm: int) -> list[Row]:
    rig, unit = Rig(cell), Unit(cell)
    wishes = drive(rig)
    times, control, bare = [], [], []
    while len(times) < DECISIONS:
        for i, dq in enumerate(wishes()):
            spent = rig.decide(i, dq)
            begin = perf_counter_ns()
            control.append(perf_counter_ns() - begin)
            if rig.tick >= warm and (np.any(dq) or len(cell.robots) == 1):
                times.append(spent)
        rig.advance()
        if rig.tick % 10 == 0:
            unit.place([np.array(q) for q in rig.setpoint])
            bare.append(unit.measure())
    queries = rig.gate._clearance.certifier.queries
    median, p99 = (float(np.percentile(times, p)) for p in (50, 99))
    one = float(np.median(bare))
    goal = GOALS[name]
    return [
        Row(f"{name}: median", median / one, "units", goal[0]),
        Row(f"{name}: p99", p99 / one, "units", goal[1]),
        Row(f"{name}: p99.9", float(np.percentile(times, 99.9)) / one, "units"),
        Row(f"{name}: median", median / 1e3, "µs"),
        Row(f"{name}: p99", p99 / 1e3, "µs"),
        Row(f"{name}: p99.9", float(np.percentile(times, 99.9)) / 1e3, "µs"),
        Row(f"{name}: control p99.9", float(np.percentile(control, 99.9)) / 1e3, "µs"),
        Row(f"{name}: unit ({len(cell.pairs)} pairs)", one / 1e3, "µs"),
        Row(f"{name}: engine queries per decision and tick", queries / rig.asked, "1"),
        Row(f"{name}: refused", rig.refused / rig.asked, "share"),
    ]


def main() -> None:
    rows = case("demo, free", demo_cell(), lambda rig: wander(rig, 0.3, 0.3), 50)
    rows += case("demo, gliding", demo_cell(), glide, 400)
    rows += case("demo + 1000 obstacles", crowded_cell(), lambda rig: wander(rig, 0.3, 0.3), 50)
    rows += case("6 robots", six_robots(), lambda rig: wander(rig, 0.2, 0.2), 50)
    report("gate", rows)


if __name__ == "__main__":
    main()
