"""Events that the gate receives, and outputs that it returns."""

from enum import StrEnum
from typing import NamedTuple

from armgate.events.immutable import event
from armgate.events.link import Joints, LinkChange, Plan, PlanAnswer, Rebase, Tick

Point = tuple[float, float, float]
"""A point in the world frame, m."""


class Outcome(StrEnum):
    """Outcome of a command."""

    ADMITTED = "admitted"
    LIMITED = "limited"
    REFUSED = "refused"


class Cause(StrEnum):
    """Cause for which a command was limited or refused, in the order of the gate's checks."""

    LEASE = "lease"
    FENCE = "fence"
    STOPPED = "stopped"
    LINK = "link"
    STALE = "stale"
    AHEAD = "ahead"
    OCCUPIED = "occupied"
    LENGTH = "length"
    NOT_FINITE = "not_finite"
    INCREMENT = "increment"
    ACCELERATION = "acceleration"
    JOINT_LIMIT = "joint_limit"
    CLEARANCE = "clearance"


@event(frozen=True, slots=True)
class Reason:
    """One cause that limited or refused a command, with its numbers.

    Attributes:
        cause: Check that applied.
        text: One sentence for the user.
        joint: Name of the joint, if a bound of a joint applied.
        pair: Names of the two bodies, if the clearance applied.
        value: Value requested or found (rad, m, ticks; by cause).
        bound: Bound that the value was compared with.
        points: Witness points on both bodies, world frame, m.
    """

    cause: Cause
    text: str
    joint: str | None = None
    pair: tuple[str, str] | None = None
    value: float | None = None
    bound: float | None = None
    points: tuple[Point, Point] | None = None


# --- events -----------------------------------------------------------------------------------------------


@event(frozen=True, slots=True)
class Command:
    """Requested increment ``dq`` to the setpoint at the robot's next tick.

    Attributes:
        robot: Name of the robot.
        fence: Fence that the client sent.
        seq: Number of the command.
        based_on: Tick that the command is based on.
        dq: Increment, rad or m per joint.
        holder: True if the client holds the robot; otherwise the command is refused, whatever its fence is.
            Recordings of version 0.2.0 and earlier lack this: there such a command has fence −1.
    """

    robot: str
    fence: int
    seq: int
    based_on: int
    dq: Joints
    holder: bool = True


@event(frozen=True, slots=True)
class LeaseChange:
    """Change of a lease: the holder's fence (None: not held) and speed bound, a share of the cell's."""

    robot: str
    fence: int | None
    speed: float = 1.0


@event(frozen=True, slots=True)
class Stop:
    """Request to bring the named robots to rest along their plans and to refuse commands until a reset."""

    robots: tuple[str, ...]
    reason: str
    by: str


@event(frozen=True, slots=True)
class Reset:
    """Request to lift the stop with this id."""

    stop: int
    by: str


GateEvent = Tick | Command | PlanAnswer | LeaseChange | Stop | Reset | LinkChange


# --- outputs ----------------------------------------------------------------------------------------------


@event(frozen=True, slots=True)
class Verdict:
    """Verdict on one command.

    Attributes:
        robot: Name of the robot.
        seq: Number of the command.
        based_on: Tick that the command was based on.
        target: Tick at which the increment is to be played; None if an admission check refused the command.
        outcome: Admitted, limited or refused.
        beta: Blend between the braking increment (0) and the requested increment (1).
        dq: Increment of the next tick by the robot's plan. The robot plays it unless a later command replaces
            it or the plan reaches the link too late.
        setpoint: Setpoint after that increment.
        reasons: Causes that applied; empty if admitted.
    """

    robot: str
    seq: int
    based_on: int
    target: int | None
    outcome: Outcome
    beta: float
    dq: Joints
    setpoint: Joints
    reasons: tuple[Reason, ...] = ()


@event(frozen=True, slots=True)
class Stopped:
    """Stop that is now in force; ``replaces`` is the id of the stop that it replaced, if any."""

    id: int
    robots: tuple[str, ...]
    reason: str
    by: str
    replaces: int | None = None


@event(frozen=True, slots=True)
class ResetAnswer:
    """Answer to a reset: lifted, or rejected as ``unknown`` or ``moving``.

    Attributes:
        stop: Id that the reset named.
        accepted: True if the stop was lifted.
        reason: Reason for a rejection.
        lifted: Id of the stop in force, if it had replaced ``stop``.
    """

    stop: int
    accepted: bool
    reason: str = ""
    lifted: int | None = None


GateOutput = Verdict | Plan | Stopped | ResetAnswer | Rebase


# --- measurements of the gate, shown in states ------------------------------------------------------------


class Nearest(NamedTuple):
    """Distance between two bodies at the measured positions.

    ``distance`` is a certified lower bound. ``points`` are the witness points (world frame, m) if a distance
    engine computed them; None if only the bound is known.
    """

    pair: tuple[str, str]
    distance: float
    limit: float
    points: tuple[Point, Point] | None
