"""The follower: one increment a tick that keeps the camera on the leader."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from armgate.control.bounds import IncrementBounds
from armgate.control.integrate import Ended, Scheme
from armgate.control.law import CameraLaw, Goal, Scene
from armgate.control.near_bodies import NearPair, limits_near_bodies
from armgate.control.predict import Predictor
from armgate.control.repulsion import Emergency, Obstacles
from armgate.control.shaping import RESERVE, braking_way, shape_chord
from armgate.control.view_errors import view_errors
from armgate.control.view_keeping import corrected, drawn_in, projection, slowed, view_vector
from armgate.control.weights import Vector

# Increments nearer to each other than this are the same, rad or m.
SHORT = 1e-9
# The chord is as long as what has to be braked for after so many ticks of speeding up. The longer it is, the
# more it turns the view, and joints that brake and speed up at once cannot always take that back: with chords
# for full speed 2 of 520 approaches got wider again, by up to 0.24°. With one tick it hardly speeds up.
SOON = 5


@dataclass(frozen=True, slots=True)
class Situation:
    """What the follower knows at a tick of its robot.

    Attributes:
        time: of the tick, s.
        setpoint: its own, (n,), rad or m; where (17) starts.
        last: the increment that led to it, (n,).
        q: measured, (n,).
        target: p, the newest measured position of the leader's tool (3,), m, or None while none is known.
        target_time: when that was measured, s, on the clock of `time`.
        distance: d_r, the wanted view distance, m.
        obstacles: the leader's spheres and the floor.
        stop_end: where the stop that the gate holds ends, (n,); None if that is not known.
        near: pairs of bodies that the gate tells of; they count where `stop_end` is known.
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


@dataclass(frozen=True, slots=True)
class Aim:
    """What is followed in one increment: the target where dq takes effect, obstacles, mode, bounds."""

    focus: Vector
    velocity: Vector
    scene: Scene
    emergency: bool
    bounds: IncrementBounds
    ways: Vector | None


@dataclass(frozen=True, slots=True)
class Way:
    """What the law makes of a tick: from `start`, with what the target induces in it, to the reference."""

    start: Vector
    induced: Vector
    end: Vector


@dataclass(frozen=True, slots=True)
class FollowStep:
    """What to do in this tick, and how it goes.

    Attributes:
        dq: the increment to send, (n,); within the bounds, and stoppable within the joint limits.
        why: what decided its length, in words.
        angle: measured view angle error, rad; None while no target is known.
        distance: measured distance error ‖p − x‖ − d_r, m; None while no target is known.
        repulsion: whether an obstacle pushes, or the robot's own body.
        emergency: whether (13) has replaced (9).
        gap: least distance to an obstacle's bounding sphere, m (inf: no obstacles).
        focus: the target as predicted for the time at which dq takes effect, (3,), m; None if none is
            fresh.
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
    """Camera law, prediction, on-line scheme and shaping put together.

    Args:
        law: of the robot that carries the camera.
        bounds: of its increments, as the gate applies them.
        period: of its clock, s.
        ahead: how long after `Situation.time` an increment sent in answer shows in the measured position,
            s: the delay of the loop (one period where the robot moves at its next tick) and the lag of the
            robot (`predict.ramp_lag`).
        scheme: how (16) is integrated.
        predictor: of the target; the default takes velocity and acceleration into account.
        stale: a target older than this, s, has vanished: the follower slows to rest.
        predict: False leaves the target where it was measured, as the paper does.
        measured: (17) taken literally: start from the measured position. On robots that lag behind their
            setpoint this overshoots; the default starts from the setpoint.
        real_time: integrate one period of real time with the term P ṗ of (4), instead of as far as the
            increment bounds allow in virtual time.
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
        self._scheme = Scheme() if scheme is None else scheme
        self._predictor = Predictor() if predictor is None else predictor
        self._stale = stale
        self._predict = predict
        self._measured = measured
        self._real_time = real_time
        self._emergency = Emergency(law.gains)
        # What has to be braked for at full speed.
        self._reach = braking_way(bounds.step, RESERVE * bounds.change)

    def step(self, now: Situation) -> FollowStep:
        """The increment for the situation `now`.

        Raises:
            ValueError: if positions or increments have the wrong length or are not finite.
        """
        self._check(now)
        if now.target is not None:
            self._predictor.update(now.target_time, now.target)
        scene = self._law.scene(now.obstacles, now.setpoint)
        emergency = self._emergency.update(scene.gap)
        age = np.inf if self._predictor.time is None else now.time - self._predictor.time
        bounds, ways = self._beside(now)
        if age > self._stale:
            dq = bounds.within(bounds.braked(now.last), now.last, now.setpoint)
            return self._told(now, scene, dq, _lost(age))
        focus, velocity = self._focus(age)
        plan = self._drift if self._real_time else self._chase
        dq, why, steps = plan(now, Aim(focus, velocity, scene, emergency, bounds, ways))
        return self._told(now, scene, dq, why, focus=focus, steps=steps)

    def _focus(self, age: float) -> tuple[Vector, Vector]:
        """The target where dq takes effect, and its velocity there."""
        if self._predict:
            return self._predictor.predict(age + self._ahead)
        return self._predictor.predict(0.0)[0], np.zeros(3)

    def _beside(self, now: Situation) -> tuple[IncrementBounds, Vector | None]:
        """Beside something tighter bounds, and what they leave of each joint's way; else the usual ones."""
        if now.stop_end is None or not now.near:
            return self._bounds, None
        lower, upper = limits_near_bodies(self._law.model, now.q, now.setpoint, now.stop_end, now.near)
        ways = np.clip(np.array((now.setpoint - lower, upper - now.setpoint)) / self._reach, 0.0, 1.0)
        return self._bounds.tightened(lower, upper), ways

    def _chase(self, now: Situation, aim: Aim) -> tuple[Vector, str, int]:
        """As far towards the optimum as the bounds allow."""
        law, bounds = self._law, aim.bounds
        q = now.q if self._measured else now.setpoint
        goal = law.goal(aim.focus, now.distance, aim.scene, emergency=aim.emergency, ways=aim.ways)
        induced = np.zeros_like(q)
        if not aim.emergency and aim.velocity.any():
            induced = self._period * law.induced(q, goal, aim.velocity)
        run = law.run(q + induced, goal, self._far(now.last, induced), self._scheme, origin=q)
        wanted = shape_chord(run.q - q, induced, bounds.step, bounds.change)
        dq = bounds.within(wanted, now.last, now.setpoint)
        bounded = bool(np.abs(dq - wanted).max() > SHORT)
        if not aim.emergency and float(np.abs(run.q - q - dq).max()) > SHORT:
            dq = self._kept(dq, Way(q, induced, run.q), goal, now, bounds)
        return dq, _reason(run.ended, aim.emergency, bounded), run.steps

    def _far(self, last: Vector, induced: Vector) -> Vector:
        """How far the reference goes, (n,): the braking way from the speed that soon may be reached."""
        bounds = self._bounds
        soon = np.minimum(np.abs(last) + SOON * bounds.change, bounds.step)
        far: Vector = np.minimum(braking_way(soon, RESERVE * bounds.change) + np.abs(induced), self._reach)
        return far

    def _kept(self, dq: Vector, way: Way, goal: Goal, now: Situation, bounds: IncrementBounds) -> Vector:
        """`dq` with the view of the law, which a piece of the straight way to its reference has not."""
        law = self._law
        psi, J_t = law.task(way.start + way.induced, goal)
        start, end = view_vector(psi), view_vector(law.task(way.end, goal)[0])
        dq = bounds.within(slowed(dq, way.induced, psi, J_t, bounds.change), now.last, now.setpoint)
        psi, J_t = law.task(way.start + dq, goal)
        v = view_vector(psi)
        if (allowed := drawn_in(v, start, end)) == v:
            return dq
        wanted = projection(allowed)
        low, high = bounds.box(dq, now.last, now.setpoint)
        dq = corrected(dq, (wanted[0] - psi[0], wanted[1] - psi[1]), J_t, low, high)
        return bounds.within(dq, now.last, now.setpoint)

    def _drift(self, now: Situation, aim: Aim) -> tuple[Vector, str, int]:
        """One period of real time along the law with P ṗ, the target at its place in the middle of it."""
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

    def _told(
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
        return view_errors(self._law.model, self._law.frame, now.q, now.target, now.distance)

    def _check(self, now: Situation) -> None:
        n = self._law.model.n
        for name, value in (("setpoint", now.setpoint), ("last", now.last), ("q", now.q)):
            if value.shape != (n,) or not np.isfinite(value).all():
                raise ValueError(f"{name}: expected {n} finite numbers, got {value}")
        if not (np.isfinite(now.time) and np.isfinite(now.distance) and now.distance > 0.0):
            raise ValueError(f"expected a finite time and a distance > 0, got {now.time} and {now.distance}")


_ENDED = {
    Ended.CONVERGED: "reaches the optimum",
    Ended.BOUND: "on the way to the optimum",
    Ended.BUDGET: "budget of steps used up",
}


def _lost(age: float) -> str:
    if age == np.inf:
        return "no position of the leader yet: slowing to rest"
    return f"no fresh position of the leader for {age:.2f} s: slowing to rest"


def _reason(ended: Ended, emergency: bool, bounded: bool) -> str:
    parts = ["emergency: obstacle avoidance alone"] if emergency else []
    parts.append(_ENDED[ended])
    if bounded:
        parts.append("acceleration or joint limit bounds it")
    return ", ".join(parts)
