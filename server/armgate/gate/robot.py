"""State of one robot in the gate: its clock, its link, the plan that it plays, its lease and stops."""

import math
from collections import deque
from dataclasses import dataclass, field, replace
from operator import add, sub
from typing import NamedTuple

from armgate.cell.cell import Robot
from armgate.events import Joints, LinkState, Nearest, Plan, Tick, Verdict
from armgate.gate.braking import end_of
from armgate.gate.clearance.swept import Swept
from armgate.gate.occupancy import Occupancy
from armgate.gate.standstill import STILL, StandstillDetector, within
from armgate.gate.step_bounds import StepBounds
from armgate.gate.tracking_lag import HullDeviation, LargestIncrements, hull_deviation_of, larger, memory

_SAME_TIME = 1e-9
"""Rounding of times, s."""

_SAME = 1e-9
"""Largest difference between the link's setpoint and the gate's own sum, rad or m: rounding only."""

JOINT_SLACK = 1e-4
"""Largest distance that a joint that starts outside its limits may move away from them in total, rad or m."""


class Reserved(NamedTuple):
    """An occupancy in joint space, and the space that the robot's bodies sweep over it."""

    occupied: Occupancy
    swept: Swept


class RobotView(NamedTuple):
    """Contents of a state message about one robot; positions are empty until its first tick."""

    tick: int
    time: float
    q: Joints
    setpoint: Joints
    stop_end: Joints
    nearest: tuple[Nearest, ...]
    least_clearance: float | None
    applied_seq: int | None
    stops: tuple[int, ...]
    link: LinkState
    late: int
    verdict: Verdict | None
    counts: dict[str, int]


@dataclass(slots=True)
class RobotState:
    """State of one robot. ``tick`` is −1 until its first tick.

    Attributes:
        robot: The robot of the cell.
        index: Its index in the configuration's order.
        bounds: Its bounds per tick.
        standstill: Counter of the ticks for which it was measured in one place.
        largest: The largest increments that its position may still reflect.
        hull_deviation: Distance by which axes that lag differently may leave the hull of the setpoints; None
            if they lag alike.
        link: State of its link.
        tick, time: Number and time stamp of its last tick.
        measured: The measured q, as reported.
        q: The measured q that the occupancy starts from (without its rounding).
        setpoint: Commanded position q_ref: the gate's own sum of the increments.
        before: The setpoint before the last increment or rebase.
        last: Increment played at the last tick.
        changed: Time of the last reported change of the setpoint, s; ``still`` ticks have passed since.
        held: The plan that the link plays; ``played`` is the index of its last increment played, −1 for none.
        pending: A plan that the link has not answered yet.
        resets: Number of rebases; part of the plans' keys.
        fence: Fence of the lease in force; None without a lease.
        share: Speed bound of the lease, as a fraction of the robot's.
        stops: Ids of the stops in force, ascending.
        faulted: True from a fault until its reset.
        untracked: True from the loss or fault of its link until its next usable tick: it may be moving.
        slot: The last tick for which a command was decided.
        outside: Distance by which each joint may still be beyond its limits (lower, upper) after a start
            outside; it only decreases.
        main: Reservation along the held plan; ``next`` is that along the pending one.
        off_path: Total distance of a faulted robot from its stop path.
        history: Setpoints of the past that the robot may still follow: those of the lag window, and the one
            before a rebase. Each with the time until which it was in force (infinite: until the next tick).
        applied_seq: Sequence number of the command applied last.
        late: Number of plans that came too late.
        verdict: The last verdict.
        nearest: The nearest pairs; ``least`` is the least distance to another robot or the surroundings, m.
        counts: Number of verdicts by outcome and cause.
        zeros: Increment of a robot that does not move.
    """

    robot: Robot
    index: int
    bounds: StepBounds
    standstill: StandstillDetector
    largest: LargestIncrements
    hull_deviation: HullDeviation | None = None
    link: LinkState = LinkState.WAITING
    tick: int = -1
    time: float = 0.0
    measured: Joints = ()
    q: Joints = ()
    setpoint: Joints = ()
    before: Joints = ()
    last: Joints = ()
    changed: float = -math.inf
    still: float = math.inf
    held: Plan | None = None
    played: int = -1
    pending: Plan | None = None
    resets: int = 0
    fence: int | None = None
    share: float = 1.0
    stops: list[int] = field(default_factory=list)
    faulted: bool = False
    untracked: bool = False
    slot: int = -1
    outside: tuple[Joints, Joints] = ((), ())
    main: Reserved | None = None
    next: Reserved | None = None
    off_path: float = 0.0
    history: deque[tuple[float, Joints]] = field(default_factory=deque)
    applied_seq: int | None = None
    late: int = 0
    verdict: Verdict | None = None
    nearest: tuple[Nearest, ...] = ()
    least: float | None = None
    counts: dict[str, int] = field(default_factory=dict)
    zeros: Joints = field(init=False)

    def __post_init__(self) -> None:
        self.zeros = (0.0,) * self.robot.model.n

    @classmethod
    def of(cls, robot: Robot, index: int) -> "RobotState":
        """Return the state of a robot before its first tick."""
        largest = LargestIncrements(memory(robot), robot.model.n)
        standstill = StandstillDetector(robot.q_tolerance, robot.period)
        return cls(robot, index, StepBounds.of(robot), standstill, largest, hull_deviation_of(robot))

    @property
    def name(self) -> str:
        """Name of the robot."""
        return self.robot.name

    @property
    def view(self) -> RobotView:
        """Contents of a state message about the robot."""
        furthest = self.next or self.main
        return RobotView(
            tick=max(self.tick, 0),
            time=self.time,
            q=self.measured,
            setpoint=self.setpoint,
            stop_end=furthest.occupied.end if furthest else (),
            nearest=self.nearest,
            least_clearance=self.least,
            applied_seq=self.applied_seq,
            stops=tuple(self.stops),
            link=self.link,
            late=self.late,
            verdict=self.verdict,
            counts=dict(self.counts),
        )

    # --- the held plan -------------------------------------------------------------------------------------

    @property
    def remaining(self) -> tuple[Joints, ...]:
        """Increments of the held plan that are still to be played."""
        return self.held.increments[self.played + 1 :] if self.held else ()

    @property
    def brake(self) -> Joints:
        """u_b: the held path's next increment, zeros at rest."""
        index = self.played + 1
        if self.held is None or index >= len(self.held.increments):
            return self.zeros
        return self.held.increments[index]

    @property
    def end(self) -> Joints:
        """Position at which the held plan ends."""
        return end_of(self.setpoint, self.remaining)

    @property
    def reserved(self) -> tuple[Reserved, ...]:
        """Everything that is reserved for the robot."""
        if self.next is None:
            return () if self.main is None else (self.main,)
        return (self.next,) if self.main is None else (self.main, self.next)

    # --- rest ----------------------------------------------------------------------------------------------

    @property
    def resting(self) -> bool:
        """True if nothing is left to play, no plan is pending, and the measured q has come to rest."""
        if self.untracked or self.pending is not None or any(map(any, (self.last, *self.remaining))):
            return False
        if self.time < self._last_change - _SAME_TIME or self.still < self._delay:
            return False
        room = self.robot.q_tolerance + STILL
        return self.standstill.reached or within(self.measured, self.setpoint, room)

    @property
    def arrived(self) -> bool:
        """True if the setpoint in force is the only one that still counts."""
        return all(same(q, self.setpoint) for _, q in self.history)

    @property
    def _last_change(self) -> float:
        """Latest time at which the robot begins to follow its setpoint, s."""
        return self.changed + self.robot.lag_window

    @property
    def _delay(self) -> int:
        """Lag window in ticks, rounded up; `_remember` keeps one tick more, because time stamps jitter."""
        return math.ceil(self.robot.lag_window / self.robot.period - _SAME_TIME)

    # --- limits and reachable positions --------------------------------------------------------------------

    def limits_now(self) -> StepBounds:
        """Return the bounds, widened for joints that started outside their limits and are not back yet."""
        low, high = self.outside
        if not any(low) and not any(high):
            return self.bounds
        b = self.bounds
        lower = tuple(x - (o + JOINT_SLACK if o else 0.0) for x, o in zip(b.lower, low, strict=True))
        upper = tuple(x + (o + JOINT_SLACK if o else 0.0) for x, o in zip(b.upper, high, strict=True))
        return replace(b, lower=lower, upper=upper)

    @property
    def reachable_points(self) -> list[Joints]:
        """Positions whose hull, widened by ``reachable_margin``, holds every position of the robot."""
        return [self.measured, self.q, self.setpoint, self.end, *(q for _, q in self.history)]

    @property
    def reachable_margin(self) -> float:
        """Largest distance of the robot from the hull of ``reachable_points`` in every joint, rad or m."""
        margin = self.robot.q_tolerance + self.off_path + JOINT_SLACK
        if self.hull_deviation is None:
            return margin
        return margin + max(self.hull_deviation.of(larger(self.largest.largest, self.bounds.speed))[0])

    @property
    def companion_margin(self) -> Joints:
        """Largest distance from its companion from the next tick on, per joint; () if its axes lag alike."""
        if self.hull_deviation is None:
            return ()
        lag_tube, between = self.hull_deviation.of(self.largest.lasting)
        return tuple(map(sub, lag_tube, between))

    # --- ticks ---------------------------------------------------------------------------------------------

    def take_tick(self, event: Tick, settled: Joints) -> None:
        """Update the state by a tick; ``settled`` is the measured q to continue with."""
        self._remember(event)
        self.changed, self.still = min(self.changed, event.time), self.still + 1
        if self.tick >= 0 and not same(event.setpoint, self.setpoint):
            self.changed, self.still = event.time, 0
        if event.time <= self._last_change + _SAME_TIME or self.still < self._delay:
            self.standstill.restart()
        self.standstill.add(event.q)
        if self.hull_deviation is not None:
            self.largest.add(_between(self.setpoint or event.q, event.setpoint))
        self.tick, self.time, self.untracked = event.tick, event.time, False
        self.measured, self.q = event.q, settled
        own = tuple(map(add, self.setpoint or event.setpoint, event.increment))
        self.before, self.last = self.setpoint, event.increment
        self.setpoint = own if same(own, event.setpoint) else event.setpoint
        self.outside = self._lowered_outside()

    def _remember(self, event: Tick) -> None:
        """Keep the setpoints of the past that the robot may still be moving to."""
        window = self.robot.lag_window
        if window <= 0.0 or self.tick < 0:
            self.history.clear()
            return
        self.history.append((event.time, self.setpoint))
        past = [(min(until, event.time), q) for until, q in self.history]
        # By ticks and by time: stamps jitter, and a clock may be faster than its period suggests.
        earliest, recent = event.time - window - _SAME_TIME, len(past) - self._delay - 1
        self.history = deque(one for k, one in enumerate(past) if k >= recent or one[0] >= earliest)

    def _lowered_outside(self) -> tuple[Joints, Joints]:
        """Return the distance by which each joint may be beyond its limits: that of its setpoint, or less."""
        if _inside(self.setpoint, self.bounds):
            return self.zeros, self.zeros
        low = tuple([max(x - q, 0.0) for x, q in zip(self.bounds.lower, self.setpoint, strict=True)])
        high = tuple([max(q - x, 0.0) for x, q in zip(self.bounds.upper, self.setpoint, strict=True)])
        if not self.outside[0]:
            return low, high
        return tuple(map(min, self.outside[0], low)), tuple(map(min, self.outside[1], high))

    # --- resets --------------------------------------------------------------------------------------------

    def setpoint_after_reset(self) -> Joints:
        """Return the setpoint after a reset: the position at which the robot stands.

        A joint that is measured within the tolerance of its setpoint keeps it: repeated resets
        must not move it by noise. An error of the measurement must not move a setpoint out of the limits.
        """
        tolerance = self.robot.q_tolerance + STILL
        at = self.measured if self.faulted or self.hull_deviation is not None else self.q
        near = [abs(m - s) <= tolerance for m, s in zip(self.measured, self.setpoint, strict=True)]
        inside = self._inside(at, tolerance)
        return tuple(s if keep else x for s, keep, x in zip(self.setpoint, near, inside, strict=True))

    def _inside(self, q: Joints, tolerance: float) -> Joints:
        """Return ``q`` with joints beyond their limits moved back to the limit, or to a setpoint beyond it.

        After a fault the robot may be anywhere: only joints beyond by at most the tolerance are moved back.
        """
        inside = []
        for x, s, lower, upper in zip(q, self.setpoint, self.bounds.lower, self.bounds.upper, strict=True):
            limited = min(max(x, min(lower, s)), max(upper, s))
            inside.append(x if self.faulted and abs(limited - x) > tolerance else limited)
        return tuple(inside)

    def rebase(self, setpoint: Joints) -> None:
        """Drop the plan and take another setpoint; until the link has it, the robot follows the old one.

        For a robot that faulted, the distance off its path and its progress back into its limits are void.
        """
        if setpoint != self.setpoint:
            self.history.append((math.inf, self.setpoint))
            self.largest.add(_between(self.setpoint, setpoint))
        self.held, self.played, self.resets = None, -1, self.resets + 1
        self.before = self.setpoint
        self.setpoint, self.last, self.slot = setpoint, self.zeros, self.tick
        if self.faulted:
            self.q, self.off_path, self.outside = self.measured, 0.0, ((), ())
            self.outside = self._lowered_outside()


def same(a: Joints, b: Joints) -> bool:
    """Return True if two finite positions are equal up to rounding errors; False if their lengths differ."""
    return a == b or (len(a) == len(b) and within(a, b, _SAME))


def _inside(q: Joints, bounds: StepBounds) -> bool:
    """Return True if every joint is inside its limits."""
    for x, lower, upper in zip(q, bounds.lower, bounds.upper, strict=True):  # noqa: SIM110 (faster than all)
        if not lower <= x <= upper:
            return False
    return True


def _between(a: Joints, b: Joints) -> Joints:
    return tuple([y - x for x, y in zip(a, b, strict=True)])
