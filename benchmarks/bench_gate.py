"""Cost of a decision of the gate, in units of one bare ``pin.computeDistances`` over the same pairs.

Both forms of the gate, in numpy and compiled, decide about the same commands one after the other, and the
unit is measured in the same process, interleaved with them. A control, the same loop without a decision,
shows the noise of the machine. The tail (p99.9) is measured over many decisions in the demo cell.

    bench_gate.py [DECISIONS [DECISIONS OF THE TAIL]]
"""

import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from time import perf_counter_ns

import numpy as np
import pinocchio as pin
from report import Row, report
from scenes import crowded_cell, demo_cell, six_robots

from armgate.cell.cell import Cell
from armgate.cell.compilation import available
from armgate.events import Command, LeaseChange, LinkChange, LinkState, Plan, PlanAnswer, Tick
from armgate.gate import Gate
from armgate.gate.clearance.engines import CoalEngine
from armgate.gate.decision import BUDGET

DECISIONS = int(sys.argv[1]) if len(sys.argv) > 1 else 4000
TAIL = int(sys.argv[2]) if len(sys.argv) > 2 else 100_000
GLIDING_AT = 0.051
"""Distance from the floor while gliding, 1 mm above the stop distance, m."""

FORMS = {"numpy": False, "compiled": True} if available() else {"numpy": False}
GOALS = {  # case: form: (median, p99) in units
    "demo, free": {"numpy": (1.5, 12.0), "compiled": (0.5, 2.0)},
    "demo, gliding": {"numpy": (5.0, 15.0), "compiled": (0.8, 4.0)},
    "demo + 1000 obstacles": {"numpy": (0.1, 0.3), "compiled": (0.05, 0.15)},
    "6 robots": {"numpy": (0.05, 0.4), "compiled": (0.03, 0.15)},
}


class Unit:
    """Unit of the benchmark: all pairs of a cell in one pinocchio geometry model, one C++ loop over them."""

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
    """Driver of all robots of a cell through a gate with ideal links in virtual time."""

    def __init__(self, cell: Cell, compiled: bool) -> None:
        self.cell, self.gate = cell, Gate(cell, "bench", compiled)
        self.setpoint = [tuple(float(x) for x in r.start) for r in cell.robots]
        self.plan: list[tuple[Plan, int] | None] = [None] * len(cell.robots)
        self.tick, self.refused, self.decided = 0, 0, 0
        self.queries, self.most = 0, 0
        for robot, q in zip(cell.robots, self.setpoint, strict=True):
            self.gate.step(LinkChange(robot.name, LinkState.READY))
            self.gate.step(LeaseChange(robot.name, 1))
            self.gate.step(Tick(robot.name, 0, 0.0, q, q, (0.0,) * robot.model.n))

    def decide(self, robot: int, dq: np.ndarray) -> int:
        """Send one command and return the duration of the decision, ns."""
        name = self.cell.robots[robot].name
        command = Command(name, 1, self.decided, self.tick, tuple(float(x) for x in dq))
        before, begin = self.evaluations, perf_counter_ns()
        out = self.gate.step(command)
        spent = perf_counter_ns() - begin
        self.most = max(self.most, self.evaluations - before)
        self.queries += self.evaluations - before
        self.decided += 1
        self.refused += len(out) == 1
        if len(out) == 2:
            self.plan[robot] = (out[1], -1)
            self.gate.step(PlanAnswer(name, out[1].key, True))
        return spent

    @property
    def evaluations(self) -> int:
        """Number of engine queries."""
        return self.gate._clearance.certifier.queries

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


def wander(rig: Rig, speed: float, spread: float) -> Callable[[], list[np.ndarray]]:
    """Return a controller that moves every robot smoothly around its start: a different sine per joint."""
    rng = np.random.default_rng(3)
    waves = [(rng.uniform(0.2, 0.5, r.model.n), rng.uniform(0, 6.3, r.model.n)) for r in rig.cell.robots]

    def increments() -> list[np.ndarray]:
        t, T = rig.tick * rig.cell.robots[0].period, rig.cell.robots[0].period
        out = []
        for robot, (f, phase) in zip(rig.cell.robots, waves, strict=True):
            amplitude = np.minimum(speed * robot.velocity, spread * 2 * np.pi * f)
            out.append(amplitude * T * np.sin(2 * np.pi * f * t + phase) * np.minimum(1.0, t / 1.0))
        return out

    return increments


def glide(rig: Rig) -> Callable[[], list[np.ndarray]]:
    """Return a controller that sweeps FR's camera just above the stop distance, at 10 % speed."""
    robot = rig.cell.robots[0]

    def increments() -> list[np.ndarray]:
        t, T = rig.tick * robot.period, robot.period
        near = min(n.distance for n in rig.gate.view(robot.name).nearest if n.limit > 0.03)
        v = np.zeros(robot.model.n)
        v[1] = np.clip(2.0 * (near - GLIDING_AT), -0.1 * robot.velocity[1], 0.1 * robot.velocity[1])
        v[0] = 0.1 * robot.velocity[0] * np.sin(0.6 * t)
        return [v * T, np.zeros(rig.cell.robots[1].model.n)]

    return increments


class Nothing:
    """Control without decisions: it measures the loop, the clock and the noise of the machine."""

    def step(self, command: Command) -> list[object]:
        return []


@dataclass
class Run:
    """Rig of one form and the durations of its decisions, ns."""

    rig: Rig
    increments: Callable[[], list[np.ndarray]]
    times: list[int] = field(default_factory=list)


def control(nothing: Nothing, command: Command) -> int:
    begin = perf_counter_ns()
    nothing.step(command)
    return perf_counter_ns() - begin


def measure(
    cell: Cell, drive, warm: int, count: int, units: bool
) -> tuple[dict[str, Run], list[int], list[int]]:
    """Let all forms decide in turn, tick by tick; return their runs, and control and unit, ns."""
    rigs = {form: Rig(cell, compiled) for form, compiled in FORMS.items()}
    runs = {form: Run(rig, drive(rig)) for form, rig in rigs.items()}
    nothing, idle, unit, bare = Nothing(), [], Unit(cell), []
    command = Command(cell.robots[0].name, 1, 0, 0, (0.0,) * cell.robots[0].model.n)
    while len(next(iter(runs.values())).times) < count:
        for run in runs.values():
            for i, dq in enumerate(run.increments()):
                spent = run.rig.decide(i, dq)
                idle.append(control(nothing, command))
                if run.rig.tick >= warm and np.any(dq):
                    run.times.append(spent)
            run.rig.advance()
        if units and run.rig.tick % 10 == 0:
            unit.place([np.array(q) for q in run.rig.setpoint])
            bare.append(unit.measure())
    return runs, idle, bare


def percentile(times: list[int], p: float) -> float:
    return float(np.percentile(times, p))


def case(name: str, cell: Cell, drive, warm: int) -> list[Row]:
    runs, idle, bare = measure(cell, drive, warm, DECISIONS, True)
    one = percentile(bare, 50)
    rows = [
        Row(f"{name}: unit ({len(cell.pairs)} pairs)", one / 1e3, "µs"),
        Row(f"{name}: control, median", percentile(idle, 50) / 1e3, "µs"),
        Row(f"{name}: control, p99", percentile(idle, 99) / 1e3, "µs"),
    ]
    for form, run in runs.items():
        what, goal, rig = f"{name}, {form}", GOALS[name][form], run.rig
        for k, (label, p) in enumerate((("median", 50), ("p99", 99))):
            rows.append(Row(f"{what}: {label}", percentile(run.times, p) / one, "units", goal[k]))
            rows.append(Row(f"{what}: {label}", percentile(run.times, p) / 1e3, "µs"))
        rows += [
            Row(f"{what}: evaluations per decision", rig.queries / rig.decided, "1"),
            Row(f"{what}: most evaluations in a decision", rig.most, "1", BUDGET),
            Row(f"{what}: refused", rig.refused / rig.decided, "share"),
        ]
    return rows


def tail() -> list[Row]:
    """Return p99.9 of many decisions in the demo cell, and of the control."""
    runs, idle, _ = measure(demo_cell(), lambda rig: wander(rig, 0.3, 0.3), 50, TAIL, False)
    rows = [Row(f"demo, {TAIL} decisions, control: p99.9", percentile(idle, 99.9) / 1e3, "µs")]
    for form, run in runs.items():
        what = f"demo, {TAIL} decisions, {form}"
        rows.append(Row(f"{what}: p99.9", percentile(run.times, 99.9) / 1e3, "µs"))
        rows.append(Row(f"{what}: most evaluations in a decision", run.rig.most, "1", BUDGET))
    return rows


def main() -> None:
    rows = case("demo, free", demo_cell(), lambda rig: wander(rig, 0.3, 0.3), 50)
    rows += case("demo, gliding", demo_cell(), glide, 400)
    rows += case("demo + 1000 obstacles", crowded_cell(), lambda rig: wander(rig, 0.3, 0.3), 50)
    rows += case("6 robots", six_robots(), lambda rig: wander(rig, 0.2, 0.2), 50)
    report("gate", rows + tail())


if __name__ == "__main__":
    main()
