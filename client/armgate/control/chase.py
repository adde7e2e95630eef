"""Chase of the optimum: the increment of a tick that the law, the bounds and the view permit.

`kernels.chase` repeats it for numba; `compiled.CompiledChase` has the same interface on top of it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from armgate.control.bounds import IncrementBounds
from armgate.control.integrate import Ended, Scheme
from armgate.control.shaping import RESERVE, braking_way, shape_chord
from armgate.control.view_keeping import corrected, drawn_in, projection, slowed, view_vector
from armgate.control.weights import Vector

if TYPE_CHECKING:
    from armgate.control.law import CameraLaw, Goal, Scene

# Largest difference of increments that count as equal, rad or m.
SHORT = 1e-9
# The chord (see `shaping`) ends at the latest where a joint has covered its braking distance from the speed
# that it can reach in this many ticks. A longer chord turns the view more, and joints that must brake or
# accelerate at the same time cannot always correct that: with the braking distance from full speed the angle
# rose again in 2 of 520 approaches, by up to 0.24°. With one tick the robot hardly accelerates.
SOON = 5


class Motion(NamedTuple):
    """Motion of the robot at a tick.

    Attributes:
        start: start of the law's path (17), (n,), rad or m.
        setpoint: setpoint, to which the increment is added, (n,).
        last: increment that led to it, (n,).
    """

    start: Vector
    setpoint: Vector
    last: Vector


class Aim(NamedTuple):
    """Goal of one increment: target at the time at which dq takes effect, its velocity, obstacles, bounds.

    Attributes:
        focus: predicted target, (3,), m.
        velocity: its velocity, (3,), m/s.
        distance: d_r, wanted view distance, m.
        scene: the obstacles.
        emergency: True to use (13) instead of (9).
        bounds: bounds of the increment; their largest steps and changes are those of every tick.
        ways: see `law.Goal`.
    """

    focus: Vector
    velocity: Vector
    distance: float
    scene: Scene
    emergency: bool
    bounds: IncrementBounds
    ways: Vector | None


class Chased(NamedTuple):
    """Increment of a tick.

    Attributes:
        dq: the increment, (n,); within the bounds, and stoppable within the joint limits.
        steps: Runge-Kutta steps made.
        ended: reason for the end of the integration.
        bounded: True if the acceleration or a joint limit shortened the increment.
    """

    dq: Vector
    steps: int
    ended: Ended
    bounded: bool


class LawPath(NamedTuple):
    """Path of the law in a tick: its start, the increment induced by the target's motion, and its end."""

    start: Vector
    induced: Vector
    end: Vector


class Chase:
    """Increments towards the optimum of a law; `CameraLaw.chase` makes it.

    Args:
        law: the law.
        bounds: bounds of the increments at every tick; those of an `Aim` may have tighter limits.
        period: period of the ticks, s.
        scheme: parameters of the integration of (16).
    """

    def __init__(self, law: CameraLaw, bounds: IncrementBounds, period: float, scheme: Scheme) -> None:
        self._law = law
        self._period = period
        self._scheme = scheme
        # Braking distance at full speed.
        self._far = braking_way(bounds.step, RESERVE * bounds.change)

    def step(self, motion: Motion, aim: Aim) -> Chased:
        """Return the increment towards the optimum, as far as the bounds allow."""
        law, q, bounds = self._law, motion.start, aim.bounds
        goal = law.goal(aim.focus, aim.distance, aim.scene, emergency=aim.emergency, ways=aim.ways)
        induced = self._induced(q, goal, aim)
        reach = self._reach(motion.last, induced, bounds)
        run = law.run(q + induced, goal, reach, self._scheme, origin=q)
        wanted = shape_chord(run.q - q, induced, bounds.step, bounds.change)
        dq = bounds.within(wanted, motion.last, motion.setpoint)
        bounded = bool(np.abs(dq - wanted).max() > SHORT)
        if not aim.emergency and float(np.abs(run.q - q - dq).max()) > SHORT:
            dq = self._with_kept_view(dq, LawPath(q, induced, run.q), goal, motion, bounds)
        return Chased(dq, run.steps, run.ended, bounded)

    def _induced(self, q: Vector, goal: Goal, aim: Aim) -> Vector:
        """Return the increment (n,) that the target's own motion requires; zeros in an emergency."""
        if aim.emergency or not aim.velocity.any():
            return np.zeros_like(q)
        return self._period * self._law.induced(q, goal, aim.velocity)

    def _reach(self, last: Vector, induced: Vector, bounds: IncrementBounds) -> Vector:
        """Return the reach of the reference, (n,): the braking distance from the speed in `SOON` ticks."""
        soon = np.minimum(np.abs(last) + SOON * bounds.change, bounds.step)
        far: Vector = np.minimum(braking_way(soon, RESERVE * bounds.change) + np.abs(induced), self._far)
        return far

    def _with_kept_view(
        self, dq: Vector, path: LawPath, goal: Goal, motion: Motion, bounds: IncrementBounds
    ) -> Vector:
        """Return `dq`, corrected to keep the view of the law's path; the straight chord would turn it."""
        law, last, setpoint = self._law, motion.last, motion.setpoint
        psi, J_t = law.task(path.start + path.induced, goal)
        start, end = view_vector(psi), view_vector(law.task(path.end, goal)[0])
        dq = bounds.within(slowed(dq, path.induced, psi, J_t, bounds.change), last, setpoint)
        psi, J_t = law.task(path.start + dq, goal)
        v = view_vector(psi)
        if (allowed := drawn_in(v, start, end)) == v:
            return dq
        wanted = projection(allowed)
        low, high = bounds.box(dq, last, setpoint)
        dq = corrected(dq, (wanted[0] - psi[0], wanted[1] - psi[1]), J_t, low, high)
        return bounds.within(dq, last, setpoint)
