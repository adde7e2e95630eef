"""Checks of one robot's motion, from state to state: limits, increments, ends of stops, stray positions."""

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from armgate.monitor import tolerances as tol
from armgate.monitor.findings import POSITIONS, Finding, FindingKind
from armgate.monitor.frames import Array
from armgate.monitor.model import Robot
from armgate.monitor.pace import Pace
from armgate.monitor.stopping import change_excess, increment_to, rest_of

MEASURED, SETPOINT, END, BRAKING = range(4)


@dataclass(frozen=True, eq=False)
class Sample:
    """State of one robot at one of its ticks; positions in rad or m.

    Attributes:
        ready: True if the link of the robot can move it.
        ended: True if the link is lost, faulted or waiting, so that states need not come.
    """

    robot: str
    tick: int
    time: float
    q: Array
    setpoint: Array
    stop_end: Array
    stops: frozenset[int] = frozenset()
    ready: bool = True
    nearest: tuple[tuple[str, str, float], ...] = ()
    ended: bool = False


@dataclass(eq=False)
class Motion:
    """What was seen of one robot.

    Attributes:
        robot: The robot.
        lockstep: True if each tick must have its exact time.
        last: Its newest sample.
        step: Its newest increment; None if it is not known.
        outside: By how much the joints may be beyond their limits, (2, n): below, above.
        moved: True if the newest sample follows a reset that took a robot where it was moved to.
    """

    robot: Robot
    lockstep: bool = False
    last: Sample | None = None
    step: Array | None = None
    outside: Array = field(default_factory=lambda: np.zeros((2, 0)))
    moved: bool = False
    _measured: deque[tuple[int, Array]] = field(default_factory=lambda: deque(maxlen=tol.MEASURED_TICKS + 1))
    _setpoints: deque[tuple[float, Array]] = field(default_factory=deque)
    _missed: float = -math.inf

    def __post_init__(self) -> None:
        T = self.robot.period
        self._pace = Pace(T)
        self._speed = self.robot.velocity * T
        self._accel, self._decel = self.robot.acceleration * T * T, self.robot.deceleration * T * T

    def take(self, sample: Sample) -> tuple[Array, list[Finding]]:
        """Check one more sample; return the poses (4, n) to look at, in the order of ``POSITIONS``."""
        before, self.last, self.moved = self.last, sample, False
        found: list[Finding] = []
        if before is not None and sample.tick <= before.tick:
            found.append(self._finding(sample, "form", f"its tick {sample.tick} follows tick {before.tick}"))
            before = None
        found += self._times(before, sample)
        step = None if before is None else sample.setpoint - before.setpoint
        if before is None or self._rebased(before, sample):
            self._begin(before, sample)
        elif step is not None:
            found += self._steps(before, sample, step)
        poses = self._poses(sample)
        found += self._ends(sample, poses)
        found += self._limits(sample, poses)
        self._remember(sample)
        return poses, found

    # --- time ---------------------------------------------------------------------------------------------

    def _times(self, before: Sample | None, sample: Sample) -> Iterator[Finding]:
        """Yield what the times of ticks have against them: all bounds of motion are per tick."""
        if before is not None and not sample.time > before.time:
            yield self._finding(
                sample, "form", f"its time is not after {before.time:.6f} s, that of the last tick"
            )
            before = None
        if before is None or not sample.ready:
            self._pace.begin()
        if self.lockstep:
            yield from self._exact(before, sample)
        elif sample.ready and (ahead := self._pace.take(sample.tick, sample.time)) is not None:
            text = (
                f"its ticks are ahead of time by {ahead.gain:.3f} s, {ahead.bound:.3f} s are allowed: "
                f"{ahead.ticks} ticks of {1e3 * self.robot.period:g} ms come in {ahead.elapsed:.3f} s"
            )
            yield self._finding(sample, "pace", text, value=ahead.gain, bound=ahead.bound)

    def _exact(self, before: Sample | None, sample: Sample) -> Iterator[Finding]:
        """Yield a tick that has another time than its number of periods in lock-step."""
        if before is None:
            return
        ticks, elapsed = sample.tick - before.tick, sample.time - before.time
        expected = ticks * round(self.robot.period * 1e9) / 1e9
        if abs(elapsed - expected) > tol.CLOCK:
            text = f"{ticks} tick(s) come in {elapsed:.9f} s; {expected:.9f} s are expected in lock-step"
            yield self._finding(sample, "pace", text, value=elapsed, bound=expected)

    # --- increments ---------------------------------------------------------------------------------------

    def _rebased(self, before: Sample, sample: Sample) -> bool:
        """Return True if the setpoint begins anew: a stop was lifted or the link came back, at q."""
        if not (before.stops - sample.stops) and before.ready and sample.ready:
            return False
        inside = np.clip(before.q, self.robot.lower, self.robot.upper)
        starts = np.stack([before.q, sample.q, before.setpoint, inside])
        off = np.abs(sample.setpoint - starts).min(axis=0)
        jump = np.abs(sample.setpoint - before.setpoint)
        if off.max() > 2.0 * self.robot.q_tolerance + tol.STILL:
            return False
        self.moved = bool(jump.max() > tol.REBASED * self.robot.q_tolerance + tol.STILL)
        return True

    def _begin(self, before: Sample | None, sample: Sample) -> None:
        """Start anew at a position that no increment led to."""
        self.step = np.zeros(self.robot.n)
        self._measured.clear()
        if before is None or not before.ready:
            self._setpoints.clear()
            self.step = None if before is None else self.step
        if before is None or self.moved:
            excess = self._excess(np.stack([sample.q, sample.setpoint]))
            self.outside = excess.max(axis=1)

    def _steps(self, before: Sample, sample: Sample, step: Array) -> Iterator[Finding]:
        ticks = sample.tick - before.tick
        bound = ticks * self._speed * (1.0 + tol.RATE) + tol.STEP
        yield from self._per_joint(sample, "speed", step, np.abs(step) - bound, ticks * self._speed)
        if ticks > 1:
            self.step, self._missed = None, sample.time
            return
        held = self.robot.holds and not step.any()
        if self._undone(step):
            held, step = True, np.zeros(self.robot.n)
        if self.step is not None and not held and before.ready and sample.ready:
            allowed = change_excess(self.step, step, self._accel, self._decel)
            slack = tol.STEP / np.minimum(self._accel, self._decel)
            over = np.where(np.abs(step - self.step) > tol.STEP, allowed - (1.0 + tol.RATE + slack), -1.0)
            yield from self._per_joint(sample, "acceleration", step - self.step, over, self._accel)
        self.step = step
        yield from self._strays(before, sample)
        yield from self._measured_speed(sample)

    def _undone(self, step: Array) -> bool:
        """Return True if the newest increment is taken back: its reply was late, and the link has held."""
        if not self.robot.holds or self.step is None:
            return False
        return bool(self.step.any() and np.abs(step + self.step).max() <= tol.STEP)

    def _measured_speed(self, sample: Sample) -> Iterator[Finding]:
        if not self._measured:
            return
        tick, q = self._measured[0]
        ticks = sample.tick - tick
        if ticks < tol.MEASURED_TICKS:
            return
        bound = (ticks + 1) * self._speed + 2.0 * self.robot.q_tolerance + tol.STEP
        moved = sample.q - q
        yield from self._per_joint(sample, "speed", moved, np.abs(moved) - bound, ticks * self._speed)

    def _strays(self, before: Sample, sample: Sample) -> Iterator[Finding]:
        """Yield joints that are neither where they were nor between the setpoints that may still act."""
        window = self.robot.lag_window + 2.0 * self.robot.period
        if sample.time - self._missed < window:
            return  # setpoints that may still act were in states that did not come
        while len(self._setpoints) > 1 and self._setpoints[1][0] <= sample.time - window:
            self._setpoints.popleft()
        corners = np.stack([before.q, sample.setpoint, *(s for _, s in self._setpoints)])
        slack = 2.0 * self.robot.q_tolerance + tol.STEP
        low, high = corners.min(axis=0) - slack, corners.max(axis=0) + slack
        over = np.maximum(low - sample.q, sample.q - high)
        if before.ready and sample.ready:
            yield from self._per_joint(sample, "stray", sample.q, over, np.clip(sample.q, low, high))

    def _remember(self, sample: Sample) -> None:
        self._measured.append((sample.tick, sample.q))
        self._setpoints.append((sample.time, sample.setpoint))

    # --- ends of stops ------------------------------------------------------------------------------------

    def _poses(self, sample: Sample) -> Array:
        """Return q, setpoint, reported end, and own end; the reported one again if that is not known."""
        own = sample.stop_end if self.step is None else sample.setpoint + rest_of(self.step, self._decel)
        return np.stack([sample.q, sample.setpoint, sample.stop_end, own])

    def _ends(self, sample: Sample, poses: Array) -> Iterator[Finding]:
        """Yield the joint whose reported end belongs to no plan that the robot may have.

        That is braking along the newest increment, or an admissible next increment and braking along it.
        """
        away = np.abs(poses[END] - poses[BRAKING])
        if self.step is None or not sample.ready or away.max() <= tol.END:
            return
        u = increment_to(poses[END] - poses[SETPOINT], self._decel)
        change = change_excess(self.step, u, self._accel, self._decel)
        loose = tol.RATE + tol.END / np.minimum(self._accel, self._decel)
        if np.all(change <= 1.0 + loose) and np.all(np.abs(u) <= self._speed * (1.0 + tol.RATE) + tol.STEP):
            return
        over = np.where(away == away.max(), away, -1.0)
        yield from self._per_joint(sample, "stop_end", poses[END], over, poses[BRAKING])

    # --- limits -------------------------------------------------------------------------------------------

    def _excess(self, poses: Array) -> Array:
        """Return by how much poses (m, n) are below and above the limits, (2, m, n)."""
        return np.maximum(np.stack([self.robot.lower - poses, poses - self.robot.upper]), 0.0)

    def _limits(self, sample: Sample, poses: Array) -> Iterator[Finding]:
        inside = np.all(poses >= self.robot.lower) and np.all(poses <= self.robot.upper)
        if inside and not self.outside.any():
            return
        excess = self._excess(poses)
        slack = np.array([tol.JOINT + 2.0 * self.robot.q_tolerance, tol.JOINT, tol.JOINT, tol.JOINT])
        allowed = np.where(self.outside > 0.0, self.outside + tol.JOINT_SLACK, 0.0)
        over = excess - allowed[:, None, :] - slack[None, :, None]
        for row, name in enumerate(POSITIONS):
            worst = over[:, row].max(axis=0)
            if (worst > 0.0).any():
                bound = np.clip(poses[row], self.robot.lower, self.robot.upper)
                yield from self._per_joint(sample, "limit", poses[row], worst, bound, name)
                self.outside = excess.max(axis=1)  # once found, a joint may come back only
                return
        # The way back is one way; the measured position is the last to come back.
        self.outside = np.minimum(self.outside, excess.max(axis=1))

    # --- findings -----------------------------------------------------------------------------------------

    def _per_joint(
        self, sample: Sample, kind: FindingKind, values: Array, over: Array, bounds: Array, where: str = ""
    ) -> Iterator[Finding]:
        """Yield one finding for the joint that is worst, if any is over."""
        joint = int(np.argmax(over))
        if not over[joint] > 0.0:
            return
        name, unit = self.robot.joints[joint], "rad" if self.robot.revolute[joint] else "m"
        value, bound = float(values[joint]), float(bounds[joint])
        text = _TEXTS[kind].format(joint=name, value=value, bound=bound, unit=unit, where=where)
        yield self._finding(sample, kind, text, joint=name, value=value, bound=bound)

    def _finding(
        self,
        sample: Sample,
        kind: FindingKind,
        text: str,
        *,
        joint: str | None = None,
        value: float | None = None,
        bound: float | None = None,
    ) -> Finding:
        return Finding(kind, self.robot.name, sample.tick, sample.time, text, value, bound, joint=joint)


_TEXTS: dict[FindingKind, str] = {
    "speed": "{joint} moves {value:.6g} {unit} in this time; {bound:.6g} {unit} is allowed",
    "acceleration": "the increment of {joint} changes by {value:.6g} {unit}; {bound:.6g} {unit} is allowed",
    "stop_end": "the stop of {joint} is said to end at {value:.6f} {unit}; by its increment it ends at "
    "{bound:.6f} {unit}",
    "stray": "{joint} is measured at {value:.6f} {unit}, which no setpoint explains; {bound:.6f} {unit} is "
    "the nearest that one does",
    "limit": "the {where} of {joint} is {value:.6f} {unit}, beyond the limit {bound:.6f} {unit}",
}
