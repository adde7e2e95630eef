"""Follower: one increment per tick that keeps the camera on the leader."""

from __future__ import annotations

from math import isfinite
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from armgate.control.bounds import IncrementBounds
from armgate.control.chase import SHORT, Aim, Motion
from armgate.control.integrate import Ended, Scheme
from armgate.control.law import CameraLaw, Scene
from armgate.control.near_bodies import NearPair, limits_near_bodies
from armgate.control.predict import Predictor
from armgate.control.repulsion import Emergency, Obstacles
from armgate.control.shaping import RESERVE, braking_way
from armgate.control.weights import Vector


class Situation(NamedTuple):
    """Inputs of the follower at a tick of its robot.

    Attributes:
        time: time of the tick, s.
        setpoint: setpoint of the robot, (n,), rad or m; start of (17).
        last: the increment that led to it, (n,).
        q: measured position, (n,).
        target: p, newest measured position of the leader's tool (3,), m; None while it is unknown.
        target_time: time of that measurement, s, on the clock of `time`.
        distance: d_r, wanted view distance, m.
        obstacles: the leader's spheres and the floor.
        stop_end: end of the stop that the gate holds, (n,); None if it is unknown.
        near: the gate's nearest pairs of bodies; used only if `stop_end` is known.
    """

    time: float
    setpoint: Vector
    last: Vector
    q: Vector
    target: ArrayLike | None
    target_time: float
    distance: float
    obstacles: Obstacles
    stop_end: Vector | None = None
    near: tuple[NearPair, ...] = ()


class FollowStep(NamedTuple):
    """Result of a tick.

    Attributes:
        dq: increment to send, (n,); within the bounds, and stoppable within the joint limits.
        why: reason for its length, in words.
        angle: measured view angle error, rad; None while no target is known.
        distance: measured distance error ‖p − x‖ − d_r, m; None while no target is known.
        repulsion: True if an obstacle or the robot's own body repels.
        emergency: True if (13) has replaced (9).
        gap: smallest distance to an obstacle's bounding sphere, m; inf without obstacles.
        focus: predicted target at the time at which dq takes effect, (3,), m; None without a recent target.
        steps: Runge-Kutta steps made.
    """

    dq: Vector
    why: str
    angle: float | None
    distance: float | None
    repulsion: bool
    emergency: bool
    gap: float
    focus: Vector | None
    steps: int


class Follower:
    """Camera law, prediction, on-line scheme and shaping combined.

    Args:
        law: law of the robot that carries the camera.
        bounds: bounds of its increments, as the gate applies them.
        period: period of its clock, s.
        ahead: time after `Situation.time` at which an increment shows in the measured position, s: the delay
            of the loop (one period if the robot moves at its next tick) and the lag of the robot
            (`predict.ramp_lag`).
        scheme: parameters of the integration of (16).
        predictor: predictor of the target; by default with velocity and acceleration.
        stale: age beyond which a target is lost, s: the follower comes to rest.
        predict: False to use the measured target, as the paper does.
        measured: True to start from the measured position, exactly as in (17). On robots that lag behind
            their setpoint this overshoots; by default the setpoint is used.
        real_time: True to integrate one period of real time with the term P ṗ of (4), instead of virtual time
            up to the increment bounds.
    """

    def __init__(
        self,
        law: CameraLaw,
        bounds: IncrementBounds,
        *,
        period: float,
        ahead: float,
        scheme: Scheme | None = None,
        predictor: Predictor | None = None,
        stale: float = 0.1,
        predict: bool = True,
        measured: bool = False,
        real_time: bool = False,
    ) -> None:
        if not (period > 0.0 and ahead >= 0.0 and stale > 0.0):
            raise ValueError(f"expected period > 0, ahead ≥ 0, stale > 0; got {period}, {ahead}, {stale}")
        if len(bounds.step) != law.model.n:
            raise ValueError(f"expected bounds for {law.model.n} joints, got {len(bounds.step)}")
        self._law = law
        self._bounds = bounds
        self._period = period
        self._ahead = ahead
        self._chased = law.chase(bounds, period, Scheme() if scheme is None else scheme)
        self._predictor = Predictor() if predictor is None else predictor
        self._stale = stale
        self._predict = predict
        self._measured = measured
        self._real_time = real_time
        self._emergency = Emergency(law.gains)
        # Braking distance at full speed.
        self._reach = braking_way(bounds.step, RESERVE * bounds.change)

    def step(self, now: Situation) -> FollowStep:
        """Return the increment for the situation `now`.

        Raises:
            ValueError: if positions or increments have the wrong length or are not finite.
        """
        self._check(now)
        if now.target is not None:
            self._predictor.update(now.target_time, now.target)
        scene = self._law.scene(now.obstacles, now.setpoint)
        emergency = self._emergency.update(scene.gap)
        age = np.inf if self._predictor.time is None else now.time - self._predictor.time
        bounds, ways = self._near_body_bounds(now)
        if age > self._stale:
            dq = bounds.within(bounds.braked(now.last), now.last, now.setpoint)
            return self._follow_step(now, scene, dq, _lost_reason(age))
        focus, velocity = self._focus(age)
        plan = self._drift if self._real_time else self._chase
        dq, why, steps = plan(now, Aim(focus, velocity, now.distance, scene, emergency, bounds, ways))
        return self._follow_step(now, scene, dq, why, focus=focus, steps=steps)

    def _focus(self, age: float) -> tuple[Vector, Vector]:
        """Return the target at the time at which dq takes effect, and its velocity there."""
        if self._predict:
            return self._predictor.predict(age + self._ahead)
        return self._predictor.predict(0.0)[0], np.zeros(3)

    def _near_body_bounds(self, now: Situation) -> tuple[IncrementBounds, Vector | None]:
        """Return bounds and `ways` (see `law.Goal`) near other bodies, else the usual bounds and None."""
        if now.stop_end is None or not now.near:
            return self._bounds, None
        lower, upper = limits_near_bodies(self._law.model, now.q, now.setpoint, now.stop_end, now.near)
        ways = np.clip(np.array((now.setpoint - lower, upper - now.setpoint)) / self._reach, 0.0, 1.0)
        return self._bounds.tightened(lower, upper), ways

    def _chase(self, now: Situation, aim: Aim) -> tuple[Vector, str, int]:
        """Return the increment towards the optimum, as far as the bounds allow."""
        start = now.q if self._measured else now.setpoint
        chased = self._chased.step(Motion(start, now.setpoint, now.last), aim)
        return chased.dq, _reason(chased.ended, aim.emergency, chased.bounded), chased.steps

    def _drift(self, now: Situation, aim: Aim) -> tuple[Vector, str, int]:
        """Return the increment of one period in real time with P ṗ, for the target at mid-period."""
        law, q = self._law, now.q if self._measured else now.setpoint
        goal = law.goal(
            aim.focus - 0.5 * self._period * aim.velocity,
            now.distance,
            aim.scene,
            emergency=aim.emergency,
            velocity=aim.velocity,
            ways=aim.ways,
        )
        wanted = law.step(q, self._period, goal) - q
        dq = aim.bounds.within(wanted, now.last, now.setpoint)
        bounded = bool(np.abs(dq - wanted).max() > SHORT)
        return dq, _reason(Ended.BOUND, aim.emergency, bounded), 1

    def _follow_step(
        self,
        now: Situation,
        scene: Scene,
        dq: Vector,
        why: str,
        *,
        focus: Vector | None = None,
        steps: int = 0,
    ) -> FollowStep:
        angle, distance = self._errors(now)
        return FollowStep(
            dq=dq,
            why=why,
            angle=angle,
            distance=distance,
            repulsion=scene.gap < self._law.gains.reach or scene.own_gap < self._law.gains.own_reach,
            emergency=self._emergency.active,
            gap=scene.gap,
            focus=focus,
            steps=steps,
        )

    def _errors(self, now: Situation) -> tuple[float | None, float | None]:
        if now.target is None:
            return None, None
        return self._law.errors(now.q, now.target, now.distance)

    def _check(self, now: Situation) -> None:
        n = self._law.model.n
        for name, value in (("setpoint", now.setpoint), ("last", now.last), ("q", now.q)):
            if value.shape != (n,) or not all(map(isfinite, value.tolist())):
                raise ValueError(f"{name}: expected {n} finite numbers, got {value}")
        if not (isfinite(now.time) and isfinite(now.distance) and now.distance > 0.0):
            raise ValueError(f"expected a finite time and a distance > 0, got {now.time} and {now.distance}")


_ENDED = {
    Ended.CONVERGED: "reaches the optimum",
    Ended.BOUND: "on the way to the optimum",
    Ended.BUDGET: "budget of steps used up",
}


def _lost_reason(age: float) -> str:
    if age == np.inf:
        return "no position of the leader yet: coming to rest"
    return f"no position of the leader for {age:.2f} s: coming to rest"


def _reason(ended: Ended, emergency: bool, bounded: bool) -> str:
    parts = ["emergency: obstacle avoidance only"] if emergency else []
    parts.append(_ENDED[ended])
    if bounded:
        parts.append("limited by acceleration or a joint limit")
    return ", ".join(parts)
