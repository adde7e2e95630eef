"""Adversaries: controllers that try to violate the invariant, and the long form of their attack.

    STEPS=1000000 SEED=0 JOBS=2 python tests/gate/adversary.py

prints at the end ``violations: N`` with the acceptance rate and the smallest margin that the oracle found,
and exits with 1 on any violation.
"""

import multiprocessing
import os
import random
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

if __name__ == "__main__":
    sys.path.insert(0, os.path.dirname(os.path.dirname(os.path.abspath(__file__))))

import numpy as np

from armgate.cell.cell import Cell, Robot
from gate import scenes
from gate.disturbances import Operator, pushed
from gate.oracle import Oracle
from gate.rig import DEVIATING, GRID, HARSH, JITTER, KEEPS, PROMPT, ROUGH, Rig, Tally, Traffic

Vector = np.ndarray


def full(rig: Rig, i: int) -> Vector:
    """Return the largest increment of every joint."""
    robot = rig.cell.robots[i]
    return robot.velocity * robot.period


def signs(rng: random.Random, n: int) -> Vector:
    return np.array([rng.choice((-1.0, 1.0)) for _ in range(n)])


# Each attack returns an increment for one tick. ``memory`` is its memory per robot, cleared when it changes.


def wild(rig: Rig, i: int, rng: random.Random, memory: dict) -> Vector:
    """Return a random increment, up to three times the largest allowed one."""
    return full(rig, i) * np.array([rng.uniform(-3, 3) for _ in full(rig, i)])


def jerky(rig: Rig, i: int, rng: random.Random, memory: dict) -> Vector:
    """Return a new direction at full speed every tick."""
    return full(rig, i) * signs(rng, len(full(rig, i)))


def steady(rig: Rig, i: int, rng: random.Random, memory: dict) -> Vector:
    """Return one direction at full speed."""
    u = full(rig, i)
    return u * memory.setdefault("d", np.array([rng.uniform(-1, 1) for _ in u]))


def greedy(rig: Rig, i: int, rng: random.Random, memory: dict, sign: float = 1.0) -> Vector:
    """Return the one of seven directions that brings the robot's nearest pair closest."""
    u = full(rig, i)
    tries = [u * np.array([rng.uniform(-1, 1) for _ in u]) for _ in range(6)]
    tries.append(memory.get("u", tries[0]))
    qs = [np.tile(p.setpoint, (len(tries), 1)) for p in rig.players]
    qs[i] = qs[i] + 8.0 * np.array(tries)
    nearest = rig.margins(qs)[:, _own(rig, i)].min(axis=1)
    memory["u"] = tries[int(np.argmin(sign * nearest))]
    return memory["u"]


def _own(rig: Rig, i: int) -> Vector:
    cache = rig.__dict__.setdefault("own_pairs", {})
    if i not in cache:
        robots = [(rig.cell.bodies[p.a].robot, rig.cell.bodies[p.b].robot) for p in rig.cell.pairs]
        cache[i] = np.array([k for k, pair in enumerate(robots) if i in pair], dtype=int)
    return cache[i]


def shy(rig: Rig, i: int, rng: random.Random, memory: dict) -> Vector:
    """Move back and forth at the boundary: toward the nearest body, away after a refusal, and again."""
    verdict = rig.last_verdict[i]
    if verdict is not None and verdict.outcome == "refused":
        memory["away"] = rng.randrange(1, 6)
    memory["away"] = memory.get("away", 0) - 1
    return greedy(rig, i, rng, memory, -1.0 if memory["away"] > 0 else 1.0)


def aimed(rig: Rig, i: int, rng: random.Random, memory: dict) -> Vector:
    """Move at full speed toward a random goal or a mirrored start, so that two robots meet in the middle."""
    robot, player = rig.cell.robots[i], rig.players[i]
    if "goal" not in memory:
        memory["goal"] = np.array([rng.uniform(a, b) for a, b in zip(robot.lower, robot.upper, strict=True)])
        if rng.random() < 0.5:
            memory["goal"] = robot.start * np.array([rng.choice((-1, 0, 1)) for _ in robot.start])
    v = memory["goal"] - np.array(player.setpoint)
    return v if np.all(np.abs(v) < full(rig, i)) else v / np.max(np.abs(v) / full(rig, i))


def first_and_last(rig: Rig, i: int, rng: random.Random, memory: dict) -> Vector:
    """Move the first and the last joint at full speed: both share one stop."""
    u = np.zeros(len(full(rig, i)))
    a, b = memory.setdefault("s", signs(rng, 2))
    if rng.random() < 0.05:
        memory["s"] = signs(rng, 2)
    u[0], u[-1] = a, b
    return full(rig, i) * u


def limits(rig: Rig, i: int, rng: random.Random, memory: dict) -> Vector:
    """Move into the nearest limit of every joint, and reverse one joint at random."""
    robot, q = rig.cell.robots[i], np.array(rig.players[i].setpoint)
    d = memory.setdefault("d", np.where(q - robot.lower < robot.upper - q, -1.0, 1.0))
    if rng.random() < 0.3:
        d[rng.randrange(len(d))] *= -1.0
    return full(rig, i) * d


def stretched(rig: Rig, i: int, rng: random.Random, memory: dict) -> Vector:
    """Straighten arm and wrist, then change direction at full speed near the singularity."""
    v = -np.array(rig.players[i].setpoint)
    v[0] = 0.0
    if np.max(np.abs(v)) < 0.1:
        return jerky(rig, i, rng, memory)
    return full(rig, i) * np.clip(v / 0.1, -1, 1)


def tremble(rig: Rig, i: int, rng: random.Random, memory: dict) -> Vector:
    """Return tiny increments, whose rounding errors must not accumulate."""
    return full(rig, i) * 10.0 ** rng.uniform(-12, -2) * signs(rng, len(full(rig, i)))


def creep(rig: Rig, i: int, rng: random.Random, memory: dict) -> Vector:
    """Move joints outside their limits back very slowly, and another joint in one direction at full speed."""
    robot, q, u = rig.cell.robots[i], np.array(rig.players[i].setpoint), full(rig, i)
    j, sign = memory.setdefault("d", (rng.choice((0, 0, rng.randrange(len(u)))), rng.choice((-1.0, 1.0))))
    d = sign * (np.arange(len(u)) == j)
    back = 1e-6 * np.where(q > robot.upper, -1.0, 1.0)
    return np.where((q > robot.upper) | (q < robot.lower), back, u * d)


ATTACKS: dict[str, Callable[..., Vector]] = {
    f.__name__: f
    for f in (wild, jerky, steady, greedy, shy, aimed, first_and_last, limits, stretched, tremble, creep)
}  # fmt: skip


@dataclass
class Adversary:
    """Controller that changes its attack at random, and leaves out commands at random."""

    rng: random.Random
    attacks: Sequence[str] = tuple(ATTACKS)
    skips: float = 0.1
    _mode: dict[int, tuple[str, int, dict]] = field(default_factory=dict)

    def __call__(self, rig: Rig, i: int) -> Vector | None:
        name, left, memory = self._mode.get(i, ("", 0, {}))
        if left <= 0:
            name, left, memory = self.rng.choice(list(self.attacks)), self.rng.randrange(3, 120), {}
        self._mode[i] = name, left - 1, memory
        if self.rng.random() < self.skips:
            return None
        return ATTACKS[name](rig, i, self.rng, memory)


@dataclass(frozen=True)
class Setting:
    """Settings of one kind of run."""

    scene: str
    lag: float | tuple[float, ...] = 0.0
    delay: float | tuple[float, ...] = 0.0
    traffic: Traffic = PROMPT
    response: str = "stop"
    share: float = 1.0
    lag_spread: float = 0.0
    """Difference between the lags of two joints, declared and true, as a share of the lag."""
    resets: float = 0.0
    """Share of grid steps at which an operator begins a series of resets of a robot."""
    beyond: float = 0.0
    """Largest distance of slides beyond their limits at the start, m."""
    attacks: tuple[str, ...] = ()
    """Names of the attacks; all if empty."""
    pushes: bool = False
    """True to push the robot into walls by hand, and do nothing else."""


NEARER = ("greedy", "shy", "steady", "jerky")
NOISY = Traffic(answer_late=3.0, answer_lost=0.2, noise=True)

SETTINGS = (
    Setting("duel", lag=0.03),
    Setting("duel_delayed", delay=(0.12, 0.0), traffic=ROUGH),
    Setting("duel", lag=(0.0, 0.12), traffic=HARSH, response="slow"),
    Setting("wire"),
    Setting("wire", lag=0.03, response="slow", traffic=ROUGH),
    Setting("corner", lag=0.12),
    Setting("corner", response="slow", traffic=HARSH),
    Setting("tree", lag=0.03),
    Setting("tree", response="slow"),
    Setting("planar", traffic=ROUGH),
    Setting("planar", lag=0.12, response="slow"),
    Setting("demo", lag=0.03, share=0.5),
    Setting("mesh", lag=0.03, traffic=ROUGH),
    Setting("mesh", response="slow"),
    Setting("duel", lag=(0.03, 0.12), lag_spread=0.3, traffic=ROUGH, share=0.3),
    Setting("tree", lag=0.03, lag_spread=1.0, response="slow", share=0.3),
    Setting("demo", lag=0.03, lag_spread=0.1, traffic=HARSH, share=0.3),
    Setting("duel_delayed", lag=0.03, delay=(0.12, 0.0), lag_spread=0.2, traffic=JITTER, share=0.3),
    Setting("boom", response="slow", traffic=NOISY, resets=0.05, attacks=NEARER, share=0.5),
    Setting("boom_delayed", delay=0.12, traffic=NOISY, resets=0.03, attacks=NEARER, share=0.3),
    Setting("duel_noisy", lag=(0.0, 0.03), traffic=HARSH, response="slow", resets=0.03, share=0.3),
    Setting("duel", lag=0.03, traffic=KEEPS, resets=0.03, share=0.3),
    Setting("lever", beyond=0.4, attacks=("creep",), share=0.5),
    Setting("lever_out", beyond=0.7, response="slow", attacks=("creep",), share=0.3),
    Setting("corner", beyond=0.3, lag=0.03, traffic=ROUGH, share=0.3),
    Setting("duel", lag=0.03, traffic=DEVIATING, share=0.3),
    Setting("lane", pushes=True, share=0.3),
    Setting("niche", pushes=True, share=0.3),
)


def duel_delayed(**changes) -> Cell:
    return scenes.duel(window=(0.12, 0.0), **changes)


def duel_noisy(**changes) -> Cell:
    return scenes.duel(tolerance=1e-4, gap=1.2, **changes)


def boom_delayed(**changes) -> Cell:
    return scenes.boom(window=0.12, **changes)


def lever_out(**changes) -> Cell:
    return scenes.lever(1.1, **changes)


_MAKE = scenes.SCENES | {
    f.__name__: f
    for f in (duel_delayed, duel_noisy, boom_delayed, lever_out, scenes.lane, scenes.niche)
}  # fmt: skip


@dataclass
class Arena:
    """Cell and oracle, used for many runs."""

    cell: Cell
    oracle: Oracle
    starts: list[list[Vector]] = field(default_factory=list)


def arena(setting: Setting) -> Arena:
    cell = _MAKE[setting.scene](response=setting.response)
    if setting.lag_spread:
        cell = scenes.lagging(cell, setting.lag, setting.lag_spread)
    return Arena(cell, Oracle(cell))


def start_of(rng: random.Random, robot: Robot, beyond: float) -> Vector:
    """Return a random start, up to 0.02 beyond the limits; some slides start farther beyond."""
    q = np.array([rng.uniform(a - 0.02, b + 0.02) for a, b in zip(robot.lower, robot.upper, strict=True)])
    for j, joint in enumerate(robot.model.joints):
        if beyond and joint.kind == "prismatic" and rng.random() < 0.7:
            by = rng.uniform(0.0, beyond)
            q[j] = rng.choice((robot.upper[j] + by, robot.upper[j] + by, robot.lower[j] - by))
    return q


def attack(
    place: Arena, setting: Setting, seed: int, commands: int, attacks: Sequence[str] = tuple(ATTACKS)
) -> Tally:
    """Run an attack on a new gate, in some runs from a start that violates the stop distance or a limit."""
    if setting.pushes:
        return pushed(place.cell, place.oracle, seed, commands)
    rng = random.Random(seed)
    start = None
    if rng.random() < (0.8 if setting.beyond else 0.3):
        start = [start_of(rng, robot, setting.beyond) for robot in place.cell.robots]
    rig = Rig(
        place.cell, seed, setting.lag, setting.delay, setting.traffic, start, place.oracle,
        lag_spread=setting.lag_spread,
    )  # fmt: skip
    if setting.resets:
        rig.operator = Operator(rng, setting.resets)
    return rig.run(Adversary(rng, setting.attacks or attacks), commands, limit=commands * 40)


def write_line(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


LENGTH = 400
"""Number of commands of one run."""


def run_of(seed: int) -> tuple[int, Setting, Tally]:
    """Run the attack with this number; the seed alone determines it, in any process."""
    setting = SETTINGS[seed % len(SETTINGS)]
    place = _ARENAS.setdefault(setting, None) or arena(setting)
    _ARENAS[setting] = place
    return seed, setting, attack(place, setting, seed, max(1, int(LENGTH * setting.share)))


_ARENAS: dict[Setting, Arena | None] = {}


def main() -> int:
    """Run attacks in ``JOBS`` processes (default: one per core) until ``STEPS`` commands are decided."""
    steps, seed = int(os.environ.get("STEPS", "20000")), int(os.environ.get("SEED", "0"))
    jobs = int(os.environ.get("JOBS", "0")) or os.cpu_count() or 1
    shares = [s.share for s in SETTINGS]
    runs = 0
    while sum(LENGTH * shares[(seed + k) % len(shares)] for k in range(runs)) < steps:
        runs += 1
    total, began = Tally(), time.monotonic()
    with multiprocessing.get_context("spawn").Pool(jobs) as pool:
        runs_done = pool.imap_unordered(run_of, range(seed, seed + runs))
        for done, (number, setting, tally) in enumerate(runs_done, 1):
            for text in tally.violations[:5]:
                write_line(f"seed {number}, {setting}: {text}")
            total.add(tally)
            if done % 50 == 0:
                spent, broken = time.monotonic() - began, len(total.violations)
                write_line(f"{total.commands} commands, {spent:.0f} s, {broken} violations")
    return print_result(total, time.monotonic() - began, jobs)


def print_result(total: Tally, spent: float, jobs: int) -> int:
    """Print the result, the violations last, and return the exit status."""
    outcomes = f"{total.admitted} admitted, {total.limited} limited, {total.refused} refused"
    write_line(
        f"{total.commands} commands: {outcomes}; {total.commands / spent:.0f} a second in {jobs} processes"
    )
    seen = f"{total.samples} positions executed, {total.stop_samples} of stops"
    write_line(f"{seen}, every {1e3 * GRID:g} ms")
    least = f"{1e3 * total.least:.4f} mm over the stop distance"
    write_line(
        f"violations: {len(total.violations)}  acceptance: {total.accepted:.3f}  smallest clearance: {least}"
    )
    return 1 if total.violations else 0


if __name__ == "__main__":
    sys.exit(main())
