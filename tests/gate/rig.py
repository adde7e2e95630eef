"""Test bench around the gate in virtual time: drives that lag, links with plans, lost messages.

Everything happens on a grid of time. The bench feeds the gate, records the true positions of the robots, also
between the ticks, and has the oracle check them all. It is written from the description of plans, not from
the code of the links.
"""

import copy
import heapq
import random
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from armgate.cell.cell import Cell
from armgate.events import (
    Command,
    GateEvent,
    GateOutput,
    LeaseChange,
    LinkChange,
    LinkState,
    Outcome,
    Plan,
    PlanAnswer,
    Rebase,
    Reset,
    Stop,
    Stopped,
    Tick,
    Verdict,
)
from armgate.gate import Gate
from gate.oracle import Oracle, step_faults

GRID = 0.002
"""Time between two samples of the true positions, s."""


class Drive:
    """True position of a robot: it follows the delayed setpoint with a first-order lag, or on a ramp.

    Joint j lags by ``lag`` plus ``apart[j]``.
    """

    def __init__(
        self, q: Sequence[float], period: float, lag: float, delay: float, apart: Sequence[float] = ()
    ) -> None:
        self.q = np.array(q, dtype=float)
        self._period, self._delay = period, delay
        lags = lag + np.array(apart or [0.0] * len(self.q))
        self._gain = 1.0 - np.exp(-GRID / lags) if lag > 0 else None
        self._steps: deque[tuple[float, np.ndarray]] = deque([(-1e9, self.q.copy())])

    def command(self, time: float, setpoint: Sequence[float]) -> None:
        self._steps.append((time, np.array(setpoint, dtype=float)))

    def advance(self, time: float) -> None:
        """Advance to ``time``, one grid step later."""
        seen = time - self._delay
        while len(self._steps) > 2 and self._steps[1][0] <= seen - self._period - GRID:
            self._steps.popleft()
        if self._gain is not None:
            held = [s for t, s in self._steps if t <= seen - GRID + 1e-9][-1]
            self.q = self.q + self._gain * (held - self.q)
            return
        self.q = self._ramp(seen)

    def _ramp(self, seen: float) -> np.ndarray:
        past = [(t, s) for t, s in self._steps if t <= seen + 1e-9]
        at, target = past[-1]
        before = past[-2][1] if len(past) > 1 else target
        share = min((seen - at) / self._period, 1.0)
        return before + share * (target - before)

    def push(self, by: np.ndarray) -> None:
        """Push the robot; it stays there until it is commanded anew."""
        self.q = self.q + by
        self._steps.clear()
        self._steps.extend([(-1e9, self.q.copy()), (-1e8, self.q.copy())])

    def distance_left(self, time: float) -> float:
        """Return the largest distance, in any joint, from the position to a setpoint that can still act."""
        seen = time - self._delay
        held = [k for k, (t, _) in enumerate(self._steps) if t <= seen + 1e-9][-1]
        return max(float(np.max(np.abs(s - self.q))) for _, s in list(self._steps)[held:])

    def resting(self) -> bool:
        """Return True if all setpoints that can still act are the same, and the robot is there."""
        target = self._steps[-1][1]
        return all(np.all(abs(s - target) < 1e-7) for s in (self.q, *(s for _, s in self._steps)))


class Player:
    """Link that holds one plan, accepts another by compare-and-swap, and plays one increment per tick.

    Args:
        robot: Name of the robot.
        q: Position of the robot.
        keeps: True if it keeps its setpoint at a rebase and the next tick reports so, as a link to a robot
            controller that accepts no other setpoint does.

    Attributes:
        factor: Factor by which the played increment differs from the plan's.
        deviates: True if the last increment differed from the plan by more than rounding.
    """

    def __init__(self, robot: str, q: Sequence[float], keeps: bool = False) -> None:
        self.robot, self.setpoint, self.keeps = robot, tuple(map(float, q)), keeps
        self.factor, self.deviates, self._rebased = 1.0, False, False
        self.tick, self.resets = -1, 0
        self.plan: Plan | None = None
        self.next: Plan | None = None
        self.index = -1
        self.last = (0.0,) * len(q)

    def offer(self, plan: Plan) -> PlanAnswer:
        key, reason = plan.key, ""
        if key.resets != self.resets:
            reason = "mismatch"
        elif key.target != self.tick + 1:
            reason = "late" if key.target <= self.tick else "early"
        elif self.next not in (None, plan) or key.last_played != self.index:
            reason = "mismatch"
        if not reason:
            self.next = plan
        return PlanAnswer(self.robot, key, not reason, reason)

    def play(self, time: float, q: Sequence[float], miss: bool = False) -> Tick:
        self.tick += 1
        zeros = (0.0,) * len(self.setpoint)
        if miss or self._rebased:
            self.plan = self.next = None
            self.index, self.last, self._rebased = -1, zeros, False
            return Tick(self.robot, self.tick, time, tuple(q), self.setpoint, zeros, rebased=True)
        if self.next is not None:
            self.plan, self.next, self.index = self.next, None, -1
        self.index += 1
        if self.plan is None or self.index >= len(self.plan.increments):
            self.plan, self.index, self.last = None, -1, zeros
            return Tick(self.robot, self.tick, time, tuple(q), self.setpoint, zeros)
        self.last = self._played(self.plan.increments[self.index])
        self.setpoint = tuple(s + u for s, u in zip(self.setpoint, self.last, strict=True))
        return Tick(
            self.robot, self.tick, time, tuple(q), self.setpoint, self.last, self.plan.key, self.index
        )

    def _played(self, planned: Sequence[float]) -> tuple[float, ...]:
        """Return the increment to play: the plan's if the difference is not distinguishable from rounding."""
        played = tuple(self.factor * u for u in planned)
        self.deviates = max(abs(a - b) for a, b in zip(played, planned, strict=True)) > 1e-8
        return played if self.deviates else tuple(planned)

    def rebase(self, order: Rebase) -> None:
        self.plan = self.next = None
        self.index, self.last = -1, (0.0,) * len(self.setpoint)
        self.resets, self._rebased = order.resets, self.keeps
        if not self.keeps:
            self.setpoint = order.setpoint

    @property
    def moves(self) -> bool:
        """True if increments are left to play, or another plan will be played."""
        held = self.plan.increments[self.index + 1 :] if self.plan else ()
        return self.next is not None or any(map(any, held))


@dataclass(frozen=True)
class Traffic:
    """Disturbances of messages and measurements; times in periods, the rest as shares.

    ``jitter`` is the largest lateness of a time stamp; for ``keeps`` see `Player`; ``deviations`` is
    the share of ticks at which a link does not play its plan.
    """

    plan_late: float = 0.0
    answer_late: float = 0.0
    plan_lost: float = 0.0
    answer_lost: float = 0.0
    missed: float = 0.0
    noise: bool = False
    jitter: float = 0.0
    keeps: bool = False
    deviations: float = 0.0


PROMPT = Traffic()
ROUGH = Traffic(plan_late=1.4, answer_late=3.0, plan_lost=0.05, answer_lost=0.2)
HARSH = Traffic(plan_late=0.9, answer_late=2.0, plan_lost=0.05, answer_lost=0.3, missed=0.01, noise=True)

KEEPS = Traffic(plan_late=1.4, answer_late=3.0, answer_lost=0.2, noise=True, keeps=True)
DEVIATING = Traffic(deviations=0.01)
JITTER = Traffic(plan_late=0.9, answer_late=2.0, jitter=0.95)

Controller = Callable[["Rig", int], Sequence[float] | None]


@dataclass
class Tally:
    """Result of a run."""

    commands: int = 0
    admitted: int = 0
    limited: int = 0
    refused: int = 0
    samples: int = 0
    stop_samples: int = 0
    least: float = np.inf
    violations: list[str] = field(default_factory=list)

    @property
    def accepted(self) -> float:
        return (self.admitted + self.limited) / max(self.commands, 1)

    def add(self, other: "Tally") -> None:
        for name in ("commands", "admitted", "limited", "refused", "samples", "stop_samples"):
            setattr(self, name, getattr(self, name) + getattr(other, name))
        self.least = min(self.least, other.least)
        self.violations += other.violations


class Rig:
    """Gate with its robots. ``need`` is each pair's required distance, m; less if it starts in violation.

    ``lag_spread`` is the difference between the lags of two joints of a robot, as a share of its lag.
    """

    def __init__(
        self,
        cell: Cell,
        seed: int = 0,
        lag: Sequence[float] | float = 0.0,
        delay: Sequence[float] | float = 0.0,
        traffic: Traffic = PROMPT,
        start: Sequence[Sequence[float]] | None = None,
        oracle: Oracle | None = None,
        stops: float = 0.01,
        lag_spread: float = 0.0,
    ) -> None:
        n = len(cell.robots)
        lags, delays = (x if isinstance(x, Sequence) else [x] * n for x in (lag, delay))
        self.cell, self.rng, self.traffic = cell, random.Random(seed), traffic
        self.oracle = oracle or Oracle(cell)
        self.gate = Gate(cell, "rig")
        q = [r.start for r in cell.robots] if start is None else start
        self.drives = [
            Drive(q[i], r.period, lags[i], delays[i], self._apart(r.model.n, lag_spread * lags[i]))
            for i, r in enumerate(cell.robots)
        ]
        self.players = [Player(r.name, q[i], traffic.keeps) for i, r in enumerate(cell.robots)]
        self.every = [round(r.period / GRID) for r in cell.robots]
        self.now, self._grid, self._count = 0.0, 0, 0
        self._mail: list[tuple[float, int, Callable[[], None]]] = []
        self._track: list[list[np.ndarray]] = []
        self._stop_rate = stops
        self.tally = Tally()
        self.events: list[GateEvent] = []
        self.outputs: list[list[GateOutput]] = []
        self.fences = [1] * n
        self.seqs = [0] * n
        self.last_verdict: list[Verdict | None] = [None] * n
        self.stopped: list[Stopped] = []
        self.expect_faults = False
        self.operator: Callable[[Rig], None] | None = None
        self.silent: set[int] = set()
        """Indices of robots that are not commanded."""
        self.noise: list[np.ndarray | None] = [None] * n
        """Measurement error of each robot; None if ``traffic`` determines it."""
        self.flying: list[list[Plan]] = [[] for _ in range(n)]
        """Plans under way to each link."""
        self.over = False
        self.outside = [self._beyond(i) for i in range(n)]
        self.need = self.needs()
        for i, robot in enumerate(cell.robots):
            self._tick(i)
            self.feed(LinkChange(robot.name, LinkState.READY))
            self.feed(LeaseChange(robot.name, 1))

    def _apart(self, joints: int, difference: float) -> list[float]:
        """Return the joints' differences from the middle lag; two random joints have ±``difference``/2."""
        if difference == 0.0 or joints < 2:
            return []
        ends = [0.5 * difference, -0.5 * difference]
        spread = ends + [self.rng.uniform(-0.5, 0.5) * difference for _ in range(joints - 2)]
        self.rng.shuffle(spread)
        return spread

    # --- time ---------------------------------------------------------------------------------------------

    def run(self, controller: Controller, commands: int, limit: int = 1_000_000) -> Tally:
        """Run until ``commands`` commands are decided; ``controller(rig, robot)`` returns one or None."""
        goal = self.tally.commands + commands
        for _ in range(limit):
            if self.tally.commands >= goal or self.over:
                break
            self.step(controller)
        self.check()
        return self.tally

    def step(self, controller: Controller | None = None) -> None:
        """Run one grid step: motion, mail, ticks, commands, and at random a check of the full stop."""
        self._grid += 1
        self.now = self._grid * GRID
        for drive in self.drives:
            drive.advance(self.now)
        self._track.append([d.q.copy() for d in self.drives])
        self._deliver()
        for i, every in enumerate(self.every):
            if self._grid % every == 0:
                self._tick(i)
                if controller is not None and i not in self.silent:
                    dq = controller(self, i)
                    if dq is not None:
                        self.command(i, dq)
        if self.operator is not None:
            self.operator(self)
        if self.rng.random() < self._stop_rate:
            self.check_stop()
        if len(self._track) >= 128:
            self.check()

    def rest(self, limit: int = 5000) -> None:
        """Let every robot play its plan to the end and come to rest."""
        for _ in range(limit):
            self.step()
            if all(d.resting() for d in self.drives):
                break
        self.check()

    def _deliver(self) -> None:
        while self._mail and self._mail[0][0] <= self.now + 1e-9:
            heapq.heappop(self._mail)[2]()

    def post(self, after: float, do: Callable[[], None]) -> None:
        self._count += 1
        heapq.heappush(self._mail, (self.now + after, self._count, do))

    # --- the gate -----------------------------------------------------------------------------------------

    def feed(self, event: GateEvent) -> list[GateOutput]:
        out = self.gate.step(event)
        self.events.append(event)
        self.outputs.append(out)
        for one in out:
            if isinstance(one, Plan):
                self._send(one)
            elif isinstance(one, Rebase):
                self._rebase(one)
            elif isinstance(one, Stopped):
                self.stopped.append(one)
                if one.by == "gate" and not self.expect_faults:
                    self.violation(f"false fault: {one.reason}")
        return out

    def command(self, i: int, dq: Sequence[float]) -> Verdict:
        self.seqs[i] += 1
        robot, player = self.cell.robots[i], self.players[i]
        out = self.feed(Command(robot.name, self.fences[i], self.seqs[i], player.tick, tuple(map(float, dq))))
        verdict = out[0]
        assert isinstance(verdict, Verdict)
        self.last_verdict[i] = verdict
        self.tally.commands += 1
        self.tally.admitted += verdict.outcome is Outcome.ADMITTED
        self.tally.limited += verdict.outcome is Outcome.LIMITED
        self.tally.refused += verdict.outcome is Outcome.REFUSED
        return verdict

    def stop(self, *robots: str) -> int:
        (stopped,) = self.feed(Stop(robots or tuple(r.name for r in self.cell.robots), "test", "rig"))
        assert isinstance(stopped, Stopped)
        return stopped.id

    def reset(self, stop: int) -> list[GateOutput]:
        """Send a reset; it is a violation if it is accepted for a robot that is not at rest."""
        names = next((s.robots for s in self.stopped if s.id == stop), ())
        robots = [self.cell.robot_index(name) for name in names]
        under_way = [i for i in robots if self.players[i].moves or self._coming(i)]
        left = {i: self.drives[i].distance_left(self.now) for i in robots}
        out = self.feed(Reset(stop, "rig"))
        if out[0].accepted:
            for i in under_way:
                self.violation(f"{self.players[i].robot} is reset with a plan under way at {self.now:.3f} s")
            for i, distance in left.items():
                if distance > 8.0 * self.cell.robots[i].q_tolerance + 1e-4 and not self.expect_faults:
                    self.violation(f"{self.players[i].robot} is reset with {distance:.5f} left to go")
        return out

    def _coming(self, i: int) -> bool:
        """Return True if a plan is under way that the link will accept."""
        return any(copy.copy(self.players[i]).offer(plan).accepted for plan in self.flying[i])

    def held(self, i: int) -> list[GateOutput]:
        """Hold the robot by hand for a period; return the outputs of its tick."""
        self._grid += self.every[i]
        self.now = self._grid * GRID
        return self.feed(self.players[i].play(self.now, [float(x) for x in self.drives[i].q]))

    def ticked(self, i: int) -> bool:
        """Return True if the robot's clock has ticked in this grid step."""
        return self._grid % self.every[i] == 0

    def _tick(self, i: int) -> None:
        robot, player, drive = self.cell.robots[i], self.players[i], self.drives[i]
        last = player.last
        miss = player.tick >= 0 and self.rng.random() < self.traffic.missed
        q = drive.q
        if self.noise[i] is not None:
            q = q + self.noise[i]
        elif self.traffic.noise:
            q = q + np.array([self.rng.uniform(-1, 1) * robot.q_tolerance for _ in q])
        late = self.traffic.jitter * robot.period * self.rng.random() if self.traffic.jitter else 0.0
        deviates = player.moves and self.rng.random() < self.traffic.deviations
        player.factor = self.rng.choice((16.0, 0.5, -1.0)) if deviates else 1.0
        player.deviates = False
        tick = player.play(self.now + late, [float(x) for x in q], miss)
        if player.deviates:
            self._expect_fault(tick)
            return
        if not miss and not tick.rebased:
            for fault in step_faults(robot, last, tick.increment, tick.setpoint, self.outside[i]):
                self.violation(f"{robot.name} tick {tick.tick}: {fault}")
        drive.command(self.now, tick.setpoint)
        self.feed(tick)

    def _expect_fault(self, tick: Tick) -> None:
        """Send a tick that differs from the plan: the gate must report a fault at once; the run ends."""
        self.over = self.expect_faults = True
        out = self.feed(tick)
        if not any(isinstance(one, Stopped) and tick.robot in one.robots for one in out):
            self.violation(f"{tick.robot} plays {tick.increment}, which is not its plan, and is not stopped")

    def _send(self, plan: Plan) -> None:
        i, t, rng = self.cell.robot_index(plan.robot), self.traffic, self.rng
        period = self.cell.robots[i].period

        def answer() -> None:
            self.flying[i].remove(plan)
            given = self.players[i].offer(plan)
            if rng.random() >= t.answer_lost:
                if t.answer_late:
                    self.post(rng.random() * t.answer_late * period, lambda: (self.feed(given), None)[1])
                else:
                    self.feed(given)

        if rng.random() < t.plan_lost:
            return
        self.flying[i].append(plan)
        if t.plan_late:
            self.post(rng.random() * t.plan_late * period, answer)
        else:
            answer()

    def _rebase(self, order: Rebase) -> None:
        i = self.cell.robot_index(order.robot)
        self.players[i].rebase(order)
        self.drives[i].command(self.now, order.setpoint)

    # --- checks by the oracle ------------------------------------------------------------------------------

    def check(self) -> None:
        """Check all positions since the last check by the oracle."""
        if not self._track:
            return
        qs = [np.stack(column) for column in zip(*self._track, strict=True)]
        self.tally.samples += len(self._track)
        self._track.clear()
        self._ask(qs, "moving")

    def check_stop(self) -> None:
        """Play a copy of every robot's plan to rest and check it: together, and each at its own time."""
        paths = [self._path_to_rest(i) for i in range(len(self.drives))]
        longest = max(map(len, paths))
        together = [np.concatenate([p, np.repeat(p[-1:], longest - len(p), axis=0)]) for p in paths]
        self.tally.stop_samples += longest
        self._ask(together, "stopping")
        if len(paths) > 1:
            picks = 24
            apart = [p[[self.rng.randrange(len(p)) for _ in range(picks)]] for p in paths]
            self.tally.stop_samples += picks
            self._ask(apart, "stopping at its own time")

    def _path_to_rest(self, i: int) -> np.ndarray:
        drive, player = copy.deepcopy(self.drives[i]), copy.copy(self.players[i])
        path, grid = [drive.q], self._grid
        while not (drive.resting() and player.plan is None and player.next is None):
            grid += 1
            drive.advance(grid * GRID)
            path.append(drive.q)
            if grid % self.every[i] == 0:
                drive.command(grid * GRID, player.play(grid * GRID, drive.q).setpoint)
            if len(path) > 2000:
                self.violation(f"{player.robot} does not come to rest")
                break
        return np.stack(path)

    def _ask(self, qs: Sequence[np.ndarray], when: str) -> None:
        least = self.oracle.least(qs, self.need)
        self.tally.least = min(self.tally.least, float(least.margin))
        for _, pair, d in least.broken[:3]:
            a, b = self.oracle.pairs[pair]
            names = f"{self.oracle.names[a]} and {self.oracle.names[b]}"
            self.violation(
                f"{when} at {self.now:.3f} s: {names} {1e3 * d:.4f} mm, {1e3 * self.need[pair]:.4f} needed"
            )

    def violation(self, text: str) -> None:
        self.tally.violations.append(text)

    def margins(self, qs: Sequence[np.ndarray]) -> np.ndarray:
        """Return lower bounds of all pairs less their limits, for attacks along the boundary."""
        return self.oracle.below(*self.oracle.place(qs)) - self.oracle.limits

    def _beyond(self, i: int) -> float:
        robot, q = self.cell.robots[i], self.drives[i].q
        worst = float(max(np.max(robot.lower - q), np.max(q - robot.upper)))
        return worst + 1e-4 if worst > 0 else 0.0

    def needs(self) -> np.ndarray:
        """Return the limits; for a pair that starts in violation, its distance less slack and tolerance."""
        need = self.oracle.limits.copy()
        R, t = self.oracle.place([d.q[None, :] for d in self.drives])
        for p in np.flatnonzero(self.oracle.below(R, t)[0] < need):
            d = self.oracle.apart(int(p), R[0], t[0])
            if d.low < need[p]:
                tolerance = 2.0 * max(r.q_tolerance for r in self.cell.robots) * 3.0
                need[p] = d.low - 2e-4 - tolerance
        return need
