"""Checks of one robot's motion, from state to state: limits, increments, ends of stops, stray positions."""

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from armgate.monitor import tolerances as tol
from armgate.monitor.braking import change_excess, increment_to, rest_of
from armgate.monitor.findings import POSITIONS, Finding, FindingKind
from armgate.monitor.model import Robot
from armgate.monitor.tick_rate import TickRate
from armgate.monitor.tick_state import TickState
from armgate.monitor.transforms import Array

MEASURED, SETPOINT, END, BRAKING = range(4)


@dataclass(eq=False)
class Motion:
    """Motion of one robot, from its states.

    Attributes:
        robot: The robot.
        lockstep: True if each tick must have its exact time.
        last: Its newest state.
        step: Its newest increment; None if it is not known.
        outside: Allowed excess of the joints beyond their limits, (2, n): below, above.
        moved: True if the newest state follows a reset that adopted a position to which the robot was moved.
    """

    robot: Robot
    lockstep: bool = False
    last: TickState | None = None
    step: Array | None = None
    outside: Array = field(default_factory=lambda: np.zeros((2, 0)))
    moved: bool = False
    _measured: deque[tuple[int, Array]] = field(default_factory=lambda: deque(maxlen=tol.MEASURED_TICKS + 1))
    _setpoints: deque[tuple[float, Array]] = field(default_factory=deque)
    _missed: float = -math.inf

    def __post_init__(self) -> None:
        T = self.robot.period
        self._rate = TickRate(T)
        self._speed = self.robot.velocity * T
        self._accel, self._decel = self.robot.acceleration * T * T, self.robot.deceleration * T * T

    def check(self, state: TickState) -> tuple[Array, list[Finding]]:
        """Check one more state; return its poses (4, n), in the order of ``POSITIONS``, and the findings."""
        before, self.last, self.moved = self.last, state, False
        found: list[Finding] = []
        if before is not None and state.tick <= before.tick:
            found.append(self._finding(state, "form", f"its tick {state.tick} follows tick {before.tick}"))
            before = None
        found += self._check_times(before, state)
        step = None if before is None else state.setpoint - before.setpoint
        if before is None or self._is_rebased(before, state):
            self._restart(before, state)
        elif step is not None:
            found += self._check_increment(before, state, step)
        poses = self._poses(state)
        if state.ready:
            found += self._check_stop_end(state, poses)
        found += self._check_limits(state, poses)
        self._remember(state)
        return poses, found

    def check_again(self, state: TickState) -> tuple[Array, list[Finding]]:
        """Check another state at the newest tick; return the same as ``check``.

        Between two ticks a robot can get another plan, and only a reset can move its setpoint.
        """
        before, self.last, self.moved = self.last, state, False
        assert before is not None
        found = list(self._check_setpoint_between_ticks(before, state))
        poses = self._poses(state)
        if before.ready:  # the plan is older than the change of the link
            found += self._check_stop_end(state, poses)
        found += self._check_limits(state, poses)
        return poses, found

    # --- time ---------------------------------------------------------------------------------------------

    def _check_times(self, before: TickState | None, state: TickState) -> Iterator[Finding]:
        """Yield the findings about the times of ticks: all bounds of motion are per tick."""
        if before is not None and not state.time > before.time:
            yield self._finding(
                state, "form", f"its time is not later than that of the previous tick, {before.time:.6f} s"
            )
            before = None
        if before is None or not state.ready:
            self._rate.begin()
        if self.lockstep:
            yield from self._check_exact_time(before, state)
        elif state.ready and (ahead := self._rate.check(state.tick, state.time)) is not None:
            text = (
                f"its ticks are early by {ahead.gain:.3f} s; {ahead.bound:.3f} s are allowed: "
                f"{ahead.ticks} ticks of {1e3 * self.robot.period:g} ms arrived in {ahead.elapsed:.3f} s"
            )
            yield self._finding(state, "pace", text, value=ahead.gain, bound=ahead.bound)

    def _check_exact_time(self, before: TickState | None, state: TickState) -> Iterator[Finding]:
        """Yield a finding if the time of a tick in lock-step differs from its number of periods."""
        if before is None:
            return
        ticks, elapsed = state.tick - before.tick, state.time - before.time
        expected = ticks * round(self.robot.period * 1e9) / 1e9
        if abs(elapsed - expected) > tol.CLOCK:
            text = f"{ticks} tick(s) took {elapsed:.9f} s; {expected:.9f} s are expected in lock-step"
            yield self._finding(state, "pace", text, value=elapsed, bound=expected)

    # --- increments ---------------------------------------------------------------------------------------

    def _is_rebased(self, before: TickState, state: TickState) -> bool:
        """Return True if the setpoint restarts at q: a stop was reset, or the link became ready again."""
        if not (before.stops - state.stops) and before.ready and state.ready:
            return False
        inside = np.clip(before.q, self.robot.lower, self.robot.upper)
        starts = np.stack([before.q, state.q, before.setpoint, inside])
        off = np.abs(state.setpoint - starts).min(axis=0)
        jump = np.abs(state.setpoint - before.setpoint)
        if off.max() > 2.0 * self.robot.q_tolerance + tol.STILL:
            return False
        self.moved = bool(jump.max() > tol.REBASED * self.robot.q_tolerance + tol.STILL)
        return True

    def _restart(self, before: TickState | None, state: TickState) -> None:
        """Restart at a position to which no increment led."""
        self.step = np.zeros(self.robot.n)
        self._measured.clear()
        if before is None or not before.ready:
            self._setpoints.clear()
            self.step = None if before is None else self.step
        if before is None or self.moved:
            excess = self._excess(np.stack([state.q, state.setpoint]))
            self.outside = excess.max(axis=1)

    def _check_increment(self, before: TickState, state: TickState, step: Array) -> Iterator[Finding]:
        ticks = state.tick - before.tick
        bound = ticks * self._speed * (1.0 + tol.RATE) + tol.STEP
        yield from self._worst_joint(state, "speed", step, np.abs(step) - bound, ticks * self._speed)
        if ticks > 1:
            self.step, self._missed = None, state.time
            return
        held = self.robot.holds and not step.any()
        if self._is_undone(step):
            held, step = True, np.zeros(self.robot.n)
        if self.step is not None and not held and before.ready and state.ready:
            allowed = change_excess(self.step, step, self._accel, self._decel)
            slack = tol.STEP / np.minimum(self._accel, self._decel)
            over = np.where(np.abs(step - self.step) > tol.STEP, allowed - (1.0 + tol.RATE + slack), -1.0)
            yield from self._worst_joint(state, "acceleration", step - self.step, over, self._accel)
        self.step = step
        yield from self._check_measured_position(before, state)
        yield from self._check_measured_speed(state)

    def _check_setpoint_between_ticks(self, before: TickState, state: TickState) -> Iterator[Finding]:
        """Yield a finding if the setpoint moves between two ticks although no stop was reset."""
        step = state.setpoint - before.setpoint
        if not step.any():
            return
        if before.stops - state.stops and self._is_rebased(before, state):
            self._restart(before, state)
            return
        allowed = np.zeros(self.robot.n)
        yield from self._worst_joint(state, "speed", step, np.abs(step) - tol.STEP, allowed)

    def _is_undone(self, step: Array) -> bool:
        """Return True if the newest increment was not played: its reply was late and the link held."""
        if not self.robot.holds or self.step is None:
            return False
        return bool(self.step.any() and np.abs(step + self.step).max() <= tol.STEP)

    def _check_measured_speed(self, state: TickState) -> Iterator[Finding]:
        if not self._measured:
            return
        tick, q = self._measured[0]
        ticks = state.tick - tick
        if ticks < tol.MEASURED_TICKS:
            return
        bound = (ticks + 1) * self._speed + 2.0 * self.robot.q_tolerance + tol.STEP
        moved = state.q - q
        yield from self._worst_joint(state, "speed", moved, np.abs(moved) - bound, ticks * self._speed)

    def _check_measured_position(self, before: TickState, state: TickState) -> Iterator[Finding]:
        """Yield joints neither at their last position nor between the setpoints that may still act."""
        window = self.robot.lag_window + 2.0 * self.robot.period
        if state.time - self._missed < window:
            return  # setpoints that may still act were in missed states
        while len(self._setpoints) > 1 and self._setpoints[1][0] <= state.time - window:
            self._setpoints.popleft()
        corners = np.stack([before.q, state.setpoint, *(s for _, s in self._setpoints)])
        slack = 2.0 * self.robot.q_tolerance + tol.STEP
        low, high = corners.min(axis=0) - slack, corners.max(axis=0) + slack
        over = np.maximum(low - state.q, state.q - high)
        if before.ready and state.ready:
            yield from self._worst_joint(state, "stray", state.q, over, np.clip(state.q, low, high))

    def _remember(self, state: TickState) -> None:
        self._measured.append((state.tick, state.q))
        self._setpoints.append((state.time, state.setpoint))

    # --- ends of stops ------------------------------------------------------------------------------------

    def _poses(self, state: TickState) -> Array:
        """Return q, setpoint, reported stop end and computed stop end, or the reported one again."""
        own = state.stop_end if self.step is None else state.setpoint + rest_of(self.step, self._decel)
        return np.stack([state.q, state.setpoint, state.stop_end, own])

    def _check_stop_end(self, state: TickState, poses: Array) -> Iterator[Finding]:
        """Yield the joint whose reported stop end belongs to no plan that the robot may have.

        Such a plan brakes along the newest increment, or along an admissible next increment.
        """
        away = np.abs(poses[END] - poses[BRAKING])
        if self.step is None or away.max() <= tol.END:
            return
        u = increment_to(poses[END] - poses[SETPOINT], self._decel)
        change = change_excess(self.step, u, self._accel, self._decel)
        loose = tol.RATE + tol.END / np.minimum(self._accel, self._decel)
        if np.all(change <= 1.0 + loose) and np.all(np.abs(u) <= self._speed * (1.0 + tol.RATE) + tol.STEP):
            return
        over = np.where(away == away.max(), away, -1.0)
        yield from self._worst_joint(state, "stop_end", poses[END], over, poses[BRAKING])

    # --- limits -------------------------------------------------------------------------------------------

    def _excess(self, poses: Array) -> Array:
        """Return how far poses (m, n) are below and above the limits, (2, m, n)."""
        return np.maximum(np.stack([self.robot.lower - poses, poses - self.robot.upper]), 0.0)

    def _check_limits(self, state: TickState, poses: Array) -> Iterator[Finding]:
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
                yield from self._worst_joint(state, "limit", poses[row], worst, bound, name)
                self.outside = excess.max(axis=1)  # after the finding, a joint may only move back
                return
        # The allowance only shrinks; the measured position returns last.
        self.outside = np.minimum(self.outside, excess.max(axis=1))

    # --- findings -----------------------------------------------------------------------------------------

    def _worst_joint(
        self,
        state: TickState,
        kind: FindingKind,
        values: Array,
        over: Array,
        bounds: Array,
        where: str = "",
    ) -> Iterator[Finding]:
        """Yield one finding for the joint with the largest excess, if there is any."""
        joint = int(np.argmax(over))
        if not over[joint] > 0.0:
            return
        name, unit = self.robot.joints[joint], "rad" if self.robot.revolute[joint] else "m"
        value, bound = float(values[joint]), float(bounds[joint])
        text = _TEXTS[kind].format(joint=name, value=value, bound=bound, unit=unit, where=where)
        yield self._finding(state, kind, text, joint=name, value=value, bound=bound)

    def _finding(
        self,
        state: TickState,
        kind: FindingKind,
        text: str,
        *,
        joint: str | None = None,
        value: float | None = None,
        bound: float | None = None,
    ) -> Finding:
        return Finding(kind, self.robot.name, state.tick, state.time, text, value, bound, joint=joint)


_TEXTS: dict[FindingKind, str] = {
    "speed": "{joint} moves {value:.6g} {unit} between the compared states; {bound:.6g} {unit} is allowed",
    "acceleration": "the increment of {joint} changes by {value:.6g} {unit}; {bound:.6g} {unit} is allowed",
    "stop_end": "the stop of {joint} is reported to end at {value:.6f} {unit}; by its increment it ends at "
    "{bound:.6f} {unit}",
    "stray": "{joint} is measured at {value:.6f} {unit}, which no setpoint explains; {bound:.6f} {unit} is "
    "the nearest explained position",
    "limit": "the {where} of {joint} is {value:.6f} {unit}, beyond the limit {bound:.6f} {unit}",
}
