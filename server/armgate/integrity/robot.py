"""All that the gate knows of one robot: what its clock told, what its link holds, who may command it."""

import math
from collections import deque
from dataclasses import dataclass, field
from operator import add, sub

import numpy as np

from armgate.cell.cell import Robot
from armgate.cell.events import Joints, LinkState, Nearest, Plan, Tick, Verdict
from armgate.integrity.lag import LargestIncrements, Stray, larger, memory, stray_of
from armgate.integrity.limits import StepBounds
from armgate.integrity.occupancy import Occupancy, occupancy
from armgate.integrity.swept import Swept

_STILL = 1e-6
"""A robot that moves less in a tick rests, rad or m: a lag's last exponential part never quite ends."""

_SAME_TIME = 1e-9
"""Rounding of times, s."""

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
        setpoint: Commanded position q_ref.
        last: Increment played at the last tick.
        held: The plan that the link plays; ``played`` is the index of its last increment played, −1 for none.
        pending: A plan that the link has not answered yet.
        main: The occupancy along the held plan; ``next`` along the pending one; ``residue`` what a rebased
            robot may still pass until it rests.
        unheard: Its link was lost or faulted, and its clock has not spoken since: it is not known to rest.
        strayed: By how much a faulted robot was found off its stop path in all.
        outside: By how much each joint may still be beyond its limits (lower, upper): a start outside,
            ratcheted back.
        slot: The tick that a command was judged for already.
        history: Setpoints that a robot with transport delay may still follow, each with the time until which
            it was in force (infinite: until the next tick).
    """

    robot: Robot
    index: int
    bounds: StepBounds
    largest: LargestIncrements
    stray: Stray | None = None
    link: LinkState = LinkState.WAITING
    tick: int = -1
    time: float = 0.0
    measured: Joints = ()
    q: Joints = ()
    setpoint: Joints = ()
    last: Joints = ()
    moved: float = 0.0
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
    residue: tuple[Reserved, ...] = ()
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
        return tuple(r for r in (self.main, self.next) if r is not None) + self.residue

    @property
    def resting(self) -> bool:
        """Nothing is left to play, and the measured q has come to rest."""
        still = not self.unheard and not any(any(u) for u in self.remaining)
        return still and self.pending is None and self.moved <= max(self.robot.q_tolerance, _STILL)

    def limits_now(self) -> StepBounds:
        """Returns the bounds, widened where the robot started outside and has not come back yet."""
        low, high = self.outside
        if not any(low) and not any(high):
            return self.bounds
        b = self.bounds
        lower = tuple(x - (o + JOINT_SLACK if o else 0.0) for x, o in zip(b.lower, low, strict=True))
        upper = tuple(x + (o + JOINT_SLACK if o else 0.0) for x, o in zip(b.upper, high, strict=True))
        return StepBounds(b.names, lower, upper, b.speed, b.accel, b.decel)

    def occupancy_to(self, end: Joints, increment: Joints) -> Occupancy:
        """Return the occupancy from the measured q over the setpoint to ``end``.

        Args:
            end: The end of the stop.
            increment: The first of the increments that lead there: no joint has a larger one after it.
        """
        past = [q for _, q in self.history]
        tolerance = self.robot.q_tolerance + self.strayed
        if self.stray is None:
            return occupancy(self.q, self.setpoint, end, past, tolerance)
        unlike = self.stray.of(larger(self.largest.largest, increment))
        return occupancy(self.q, self.setpoint, end, past, tolerance, unlike)

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
        if self.stray is not None:
            self.largest.add(_between(self.setpoint or event.q, event.setpoint))
        self.moved = _farthest(event.q, self.measured) if self.tick >= 0 else 0.0
        self.tick, self.time, self.unheard = event.tick, event.time, False
        self.measured, self.q = event.q, settled
        self.setpoint, self.last = event.setpoint, event.increment
        self.outside = self._ratchet()

    def _remember(self, event: Tick) -> None:
        """Keeps the setpoints that a robot with the declared transport delay may still be on its way to."""
        window = self.robot.lag_window
        if window <= 0.0 or self.tick < 0:
            return
        self.history.append((event.time, self.setpoint))
        past = [(min(until, event.time), q) for until, q in self.history]
        self.history = deque((until, q) for until, q in past if until >= event.time - window - _SAME_TIME)

    def rebase(self) -> None:
        """The setpoint becomes the measured q; a delayed robot may still be on its way to the old one."""
        if self.robot.lag_window > 0.0:
            self.history.append((math.inf, self.setpoint))
        self.held, self.played, self.resets = None, -1, self.resets + 1
        self.largest.add(_between(self.setpoint, self.measured))
        self.setpoint, self.last, self.q = self.measured, self.zeros, self.measured
        # Until the link has heard of it, the robot is on its way to the old setpoint. What was reserved for
        # one that faulted is void.
        residue = () if self.faulted else self.reserved
        self.slot, self.residue, self.strayed = self.tick, residue, 0.0

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
    )
    largest = LargestIncrements(memory(robot), robot.model.n)
    return RobotState(robot, index, bounds, largest, stray_of(robot))


def end_of(setpoint: Joints, increments: tuple[Joints, ...]) -> Joints:
    """Returns the setpoint after all increments, added one by one as a link adds them."""
    for u in increments:
        setpoint = tuple(map(add, setpoint, u))
    return setpoint


def _between(a: Joints, b: Joints) -> Joints:
    return tuple([y - x for x, y in zip(a, b, strict=True)])


def _farthest(a: Joints, b: Joints) -> float:
    return max((abs(x - y) for x, y in zip(a, b, strict=True)), default=0.0)
