"""Disturbances of an attack: repeated resets by an operator, wrong ticks of links, pushes by hand."""

import random

import numpy as np

from armgate.cell.cell import Cell
from armgate.events import Outcome, Stopped
from gate.oracle import Oracle
from gate.rig import GRID, Rig, Tally

_NEAR = 0.05
"""Margin below which a robot is reset more often, m."""

_STANDS = 0.7
"""Longest time that a robot at rest may wait for its reset to be accepted, s."""


class Operator:
    """Operator with repeated stops and resets of a robot, at rest and in motion, under the worst noise.

    Args:
        rng: Random numbers.
        rate: Share of grid steps at which a series of resets begins, mostly with robots near other bodies.
    """

    def __init__(self, rng: random.Random, rate: float) -> None:
        self._rng, self._rate = rng, rate
        self._robot, self._left, self._stop, self._stands = 0, 0, None, 0.0

    def __call__(self, rig: Rig) -> None:
        if self._left == 0:
            self._begin(rig)
        elif rig.ticked(self._robot):
            self._again(rig)

    def _begin(self, rig: Rig) -> None:
        if self._rng.random() >= self._rate:
            return
        i = self._rng.randrange(len(rig.players))
        here = [d.q[None, :] for d in rig.drives]
        if self._rng.random() < 0.9 and rig.margins(here).min() > _NEAR:
            return
        self._robot, self._left, self._stands = i, self._rng.randrange(3, 40), 0.0
        rig.noise[i] = worst_noise(rig, i)
        if self._rng.random() < 0.7:
            rig.silent.add(i)

    def _again(self, rig: Rig) -> None:
        i, name = self._robot, rig.cell.robots[self._robot].name
        if self._stop is None:
            self._stop = rig.stop(name)
        if not rig.reset(self._stop)[0].accepted:
            self._wait(rig)
            return
        self._stop, self._stands = None, 0.0
        self._left -= 1
        if self._left == 0:
            rig.noise[i] = None
            rig.silent.discard(i)

    def _wait(self, rig: Rig) -> None:
        i = self._robot
        self._stands = self._stands + rig.every[i] * GRID if rig.drives[i].resting() else 0.0
        if self._stands > _STANDS:
            rig.violation(f"{rig.cell.robots[i].name} stands for {self._stands:.2f} s and is not reset")
            self._stop, self._left, rig.noise[i] = None, 0, None


def worst_noise(rig: Rig, i: int) -> np.ndarray:
    """Return a measurement error of the tolerance in every joint, toward the nearest body."""
    robot, here = rig.cell.robots[i], [d.q for d in rig.drives]
    n = robot.model.n
    qs = [np.tile(q, (2 * n, 1)) for q in here]
    qs[i] = qs[i] + 1e-3 * np.concatenate([np.eye(n), -np.eye(n)])
    nearest = rig.margins(qs).min(axis=1)
    return robot.q_tolerance * np.where(nearest[:n] < nearest[n:], 1.0, -1.0)


def pushed(cell: Cell, oracle: Oracle, seed: int, commands: int) -> Tally:
    """Push a cart deeper into walls by hand, after a retreat, and command the straight way out.

    Args:
        cell: One cart with a ball of 5 cm, and a wall across each of its first axes, its face at 0.5 m.
        oracle: Its oracle.
        seed: Seed of the random numbers.
        commands: Number of commands.
    """
    rng, (robot,) = random.Random(seed), cell.robots
    walls = len(cell.surroundings)
    inward = 1e-4 * np.array([1.0 if j < walls else 0.0 for j in range(robot.model.n)])
    edge = 0.45 - cell.config.stop_distance
    start = (edge + rng.uniform(-0.005, 0.015)) * inward / 1e-4
    rig = Rig(cell, seed, oracle=oracle, start=[start], stops=0.0)
    rig.expect_faults = True
    while rig.tally.commands < commands and not rig.tally.violations:
        for _ in range(rng.randrange(0, 150)):
            rig.step(lambda rig, i: rng.choice((-1.0, -1.0, 1.0)) * inward)
        rig.rest()
        if np.max(rig.drives[0].q) < 0.5:
            _push(rig, inward * rng.uniform(1, 150))
        _ask(rig, inward, edge)
    return rig.tally


def _push(rig: Rig, by: np.ndarray) -> None:
    rig.drives[0].push(by)
    faults = [o for o in rig.held(0) if isinstance(o, Stopped)]
    if not faults:
        rig.violation(f"a push by {np.max(by):.4f} causes no fault")
        return
    for _ in range(round(_STANDS / rig.cell.robots[0].period)):
        rig.held(0)
        if rig.reset(faults[0].id)[0].accepted:
            rig.need = rig.needs()
            rig.step()
            return
    rig.violation("a robot that stands after a push is not reset")


def _ask(rig: Rig, inward: np.ndarray, edge: float) -> None:
    """Check that motion deeper into a violation is refused, and motion out of it admitted."""
    deeper = float(np.max(rig.drives[0].q)) - edge
    for dq, refused in ((3.0 * inward, True), (-inward, False)):
        for _ in range(rig.every[0]):
            rig.step()
        verdict = rig.command(0, dq)
        if deeper > 1e-3 and (verdict.outcome is Outcome.REFUSED) != refused:
            reasons = verdict.reasons[-1:]
            rig.violation(f"{1e3 * deeper:.2f} mm too near, {dq} is {verdict.outcome} {reasons}")
