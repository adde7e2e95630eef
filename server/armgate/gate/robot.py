"""All that the gate knows of one robot: what its clock told, what its link holds, who may command it."""

import math
from collections import deque
from dataclasses import dataclass, field, replace
from operator import add, sub

import numpy as np

from armgate.cell.cell import Robot
from armgate.events import Joints, LinkState, Nearest, Plan, Tick, Verdict
from armgate.gate.lag import LargestIncrements, Stray, larger, memory, stray_of
from armgate.gate.limits import StepBounds
from armgate.gate.occupancy import Occupancy, occupancy
from armgate.gate.rest import STILL, Stillness, within
from armgate.gate.swept import Swept

_SAME_TIME = 1e-9
"""Rounding of times, s."""

_SAME = 1e-9
"""How far the link's setpoint may differ from the gate's own sum, rad or m: rounding only."""

JOINT_SLACK = 1e-4
"""How far a joint that starts outside its limits may fall back in all, rad or m."""


@dataclass(frozen=True, slots=True)
class Reserved:
    """An occupancy and what it means in space."""

    occupied: Occupancy
    swept: Swept


@dataclass(slots=True)
class RobotState:
    """One robot, as the gate sees it. ``tick`` is −1 until its clock has spoken.

    Attributes:
        robot: The robot of the cell.
        index: Its place in the configuration's order.
        bounds: Its bounds per tick.
        largest: The largest increments that its position may still reflect.
        stray: By how much of them axes that lag differently may leave the hull of the setpoints; None: alike.
        measured: The measured q, as reported.
        q: The measured q that the occupancy starts from (rounding taken off).
        setpoint: Commanded position q_ref: the gate's own sum of the increments.
        before: The setpoint before the last increment or rebase.
        last: Increment played at the last tick.
        held: The plan that the link plays; ``played`` is the index of its last increment played, −1 for none.
        pending: A plan that the link has not answered yet.
        stillness: How long it was measured in one place.
        changed: When its link last reported another setpoint, s; ``still`` ticks have passed since.
        main: The occupancy along the held plan; ``next`` along the pending one.
        unheard: Its link was lost or faulted, and its clock has not spoken since: it is not known to rest.
        strayed: By how much a faulted robot was found off its stop path in all.
        outside: By how much each joint may still be beyond its limits (lower, upper): a start outside,
            ratcheted back.
        slot: The tick that a command was judged for already.
        history: Setpoints of the past that the robot may still follow: those of the lag window, and the one
            before a rebase. Each with the time until which it was in force (infinite: until the next tick).
    """

    robot: Robot
    index: int
    bounds: StepBounds
    stillness: Stillness
    largest: LargestIncrements
    stray: Stray | None = None
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
    unheard: bool = False
    slot: int = -1
    outside: tuple[Joints, Joints] = ((), ())
    main: Reserved | None = None
    next: Reserved | None = None
    strayed: float = 0.0
    history: deque[tuple[float, Joints]] = field(default_factory=deque)
    applied_seq: int | None = None
    late: int = 0
    verdict: Verdict | None = None
    nearest: tuple[Nearest, ...] = ()
    least: float | None = None
    counts: dict[str, int] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """The robot's name."""
        return self.robot.name

    @property
    def zeros(self) -> Joints:
        """No motion."""
        return (0.0,) * self.robot.model.n

    @property
    def remaining(self) -> tuple[Joints, ...]:
        """The increments that the held plan still has."""
        return self.held.increments[self.played + 1 :] if self.held else ()

    @property
    def brake(self) -> Joints:
        """u_b: the held path's next increment, zeros at rest."""
        rest = self.remaining
        return rest[0] if rest else self.zeros

    @property
    def end(self) -> Joints:
        """Where the held plan ends."""
        return end_of(self.setpoint, self.remaining)

    @property
    def reserved(self) -> tuple[Reserved, ...]:
        """Everything that is reserved for the robot."""
        return tuple(r for r in (self.main, self.next) if r is not None)

    @property
    def resting(self) -> bool:
        """True if nothing is left to play, no plan is under way, and the measured q has come to rest."""
        if self.unheard or self.pending is not None or any(map(any, (self.last, *self.remaining))):
            return False
        if self.time < self._last_change - _SAME_TIME or self.still < self._delay:
            return False
        room = self.robot.q_tolerance + STILL
        return self.stillness.reached or within(self.measured, self.setpoint, room)

    @property
    def arrived(self) -> bool:
        """True if no setpoint of the past counts any more but the one in force."""
        return all(same(q, self.setpoint) for _, q in self.history)

    def limits_now(self) -> StepBounds:
        """Returns the bounds, widened where the robot started outside and has not come back yet."""
        low, high = self.outside
        if not any(low) and not any(high):
            return self.bounds
        b = self.bounds
        lower = tuple(x - (o + JOINT_SLACK if o else 0.0) for x, o in zip(b.lower, low, strict=True))
        upper = tuple(x + (o + JOINT_SLACK if o else 0.0) for x, o in zip(b.upper, high, strict=True))
        return replace(b, lower=lower, upper=upper)

    @property
    def places(self) -> list[Joints]:
        """Positions whose hull, widened by ``room``, holds every position that the robot may have or pass."""
        return [self.measured, self.q, self.setpoint, self.end, *(q for _, q in self.history)]

    @property
    def room(self) -> float:
        """How far the robot may be from the hull of ``places``, in every joint, rad or m."""
        room = self.robot.q_tolerance + self.strayed + JOINT_SLACK
        if self.stray is None:
            return room
        return room + max(self.stray.of(larger(self.largest.largest, self.bounds.speed))[0])

    def occupancy_to(self, end: Joints, increment: Joints) -> Occupancy:
        """Return the occupancy from the measured q over the setpoint to ``end``.

        Args:
            end: The end of the stop.
            increment: The first of the increments that lead there: no joint has a larger one after it.
        """
        return self._cover(self.setpoint, end, [q for _, q in self.history], increment)

    def occupancy_at(self, setpoint: Joints) -> Occupancy:
        """Return the occupancy after a rebase to ``setpoint``, until the link has it."""
        past = [*(q for _, q in self.history), self.setpoint]
        return self._cover(setpoint, setpoint, past, _between(self.setpoint, setpoint))

    def _cover(self, setpoint: Joints, end: Joints, past: list[Joints], increment: Joints) -> Occupancy:
        first, tolerance = self.q, self.robot.q_tolerance + self.strayed
        if past and first == setpoint:  # the way from the farthest setpoint of the past covers it tighter
            first = max(past, key=lambda q: math.dist(q, setpoint))
        if self.stray is None:
            return occupancy(first, setpoint, end, past, tolerance)
        unlike = self.stray.of(larger(self.largest.largest, increment))
        return occupancy(first, setpoint, end, past, tolerance, unlike)

    @property
    def off_companion(self) -> Joints:
        """How far it may be off its companion from the next tick on; () if its axes lag alike."""
        if self.stray is None:
            return ()
        unlike, between = self.stray.of(self.largest.lasting)
        return tuple(map(sub, unlike, between))

    def take_tick(self, event: Tick, settled: Joints) -> None:
        """Takes over what the clock told; ``settled`` is the measured q to go on with."""
        self._remember(event)
        self.changed, self.still = min(self.changed, event.time), self.still + 1
        if self.tick >= 0 and not same(event.setpoint, self.setpoint):
            self.changed, self.still = event.time, 0
        if event.time <= self._last_change + _SAME_TIME or self.still < self._delay:
            self.stillness.begin()
        self.stillness.note(event.q)
        if self.stray is not None:
            self.largest.add(_between(self.setpoint or event.q, event.setpoint))
        self.tick, self.time, self.unheard = event.tick, event.time, False
        self.measured, self.q = event.q, settled
        own = tuple(map(add, self.setpoint or event.setpoint, event.increment))
        self.before, self.last = self.setpoint, event.increment
        self.setpoint = own if same(own, event.setpoint) else event.setpoint
        self.outside = self._ratchet()

    @property
    def _last_change(self) -> float:
        """When the robot begins to follow its setpoint at the latest, s."""
        return self.changed + self.robot.lag_window

    def _remember(self, event: Tick) -> None:
        """Keep the setpoints of the past that the robot may still be on its way to."""
        window = self.robot.lag_window
        if window <= 0.0 or self.tick < 0:
            self.history.clear()
            return
        self.history.append((event.time, self.setpoint))
        past = [(min(until, event.time), q) for until, q in self.history]
        # By ticks and by time: stamps jitter, and a clock may be faster than its period says.
        earliest, recent = event.time - window - _SAME_TIME, len(past) - self._delay - 1
        self.history = deque(one for k, one in enumerate(past) if k >= recent or one[0] >= earliest)

    @property
    def _delay(self) -> int:
        """The lag window in ticks. Stamps jitter: a setpoint of the past counts for one more."""
        return math.ceil(self.robot.lag_window / self.robot.period - _SAME_TIME)

    def stand(self) -> Joints:
        """Return the setpoint after a reset: where the robot stands.

        A joint that is measured within the tolerance of its setpoint keeps it: noise must not move it, reset
        by reset. A joint inside its limits is not led out of them by what the measurement may err by.
        """
        tolerance = self.robot.q_tolerance + STILL
        at = self.measured if self.faulted or self.stray is not None else self.q
        near = [abs(m - s) <= tolerance for m, s in zip(self.measured, self.setpoint, strict=True)]
        inside = self._inside(at, tolerance)
        return tuple(s if keep else x for s, keep, x in zip(self.setpoint, near, inside, strict=True))

    def _inside(self, q: Joints, tolerance: float) -> Joints:
        """Return ``q`` with the joints beyond their limits taken back to them, or to the setpoint outside.

        Of a robot that faulted only those that are beyond by no more than the tolerance: it may be anywhere.
        """
        inside = []
        for x, s, lower, upper in zip(q, self.setpoint, self.bounds.lower, self.bounds.upper, strict=True):
            limited = min(max(x, min(lower, s)), max(upper, s))
            inside.append(x if self.faulted and abs(limited - x) > tolerance else limited)
        return tuple(inside)

    def rebase(self, setpoint: Joints) -> None:
        """Drop the plan and take another setpoint; until the link has it, the robot follows the old one.

        What a robot that faulted had strayed and had reached on its way back into its limits is void.
        """
        if setpoint != self.setpoint:
            self.history.append((math.inf, self.setpoint))
            self.largest.add(_between(self.setpoint, setpoint))
        self.held, self.played, self.resets = None, -1, self.resets + 1
        self.before = self.setpoint
        self.setpoint, self.last, self.slot = setpoint, self.zeros, self.tick
        if self.faulted:
            self.q, self.strayed, self.outside = self.measured, 0.0, ((), ())
            self.outside = self._ratchet()

    def _ratchet(self) -> tuple[Joints, Joints]:
        low = tuple(max(x - q, 0.0) for x, q in zip(self.bounds.lower, self.setpoint, strict=True))
        high = tuple(max(q - x, 0.0) for x, q in zip(self.bounds.upper, self.setpoint, strict=True))
        if not self.outside[0]:
            return low, high
        best_low = tuple(min(a, b) for a, b in zip(self.outside[0], low, strict=True))
        best_high = tuple(min(a, b) for a, b in zip(self.outside[1], high, strict=True))
        return best_low, best_high


def robot_state(robot: Robot, index: int) -> RobotState:
    """Returns the state of a robot whose clock has not spoken yet."""
    T = robot.period

    def row(values: np.ndarray) -> Joints:
        return tuple(float(x) for x in values)

    bounds = StepBounds(
        names=tuple(j.name for j in robot.model.joints),
        lower=row(robot.lower),
        upper=row(robot.upper),
        speed=row(robot.velocity * T),
        accel=row(robot.acceleration * T * T),
        decel=row(robot.deceleration * T * T),
        kinds=tuple(j.kind for j in robot.model.joints),
    )
    largest = LargestIncrements(memory(robot), robot.model.n)
    stillness = Stillness(robot.q_tolerance, T)
    return RobotState(robot, index, bounds, stillness, largest, stray_of(robot))


def end_of(setpoint: Joints, increments: tuple[Joints, ...]) -> Joints:
    """Returns the setpoint after all increments, added one by one as a link adds them."""
    for u in increments:
        setpoint = tuple(map(add, setpoint, u))
    return setpoint


def same(a: Joints, b: Joints) -> bool:
    """Return True if two positions are the same to rounding; those of another length never are."""
    return len(a) == len(b) and all(abs(x - y) <= _SAME for x, y in zip(a, b, strict=True))


def _between(a: Joints, b: Joints) -> Joints:
    return tuple([y - x for x, y in zip(a, b, strict=True)])
