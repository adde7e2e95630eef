"""What the gate is told and what it answers: plain data, shared by links, daemon, gate and recordings.

Every value is immutable and holds only numbers, texts and tuples, so that an event log can be written,
compared and replayed. Increments and positions are in rad (revolute) and m (prismatic), times in s.

One increment's way: a ``Command`` is judged by the gate and answered by a ``Verdict``; if it was let through,
a ``Plan`` goes to the robot's link, which answers it (``PlanAnswer``) and plays it tick by tick (``Tick``).
"""

from dataclasses import dataclass
from enum import StrEnum

Joints = tuple[float, ...]
"""One number per joint of one robot, in the order of its model."""

Point = tuple[float, float, float]
"""A point in the world frame, m."""


class Outcome(StrEnum):
    """What became of a command."""

    ADMITTED = "admitted"
    LIMITED = "limited"
    REFUSED = "refused"


class Cause(StrEnum):
    """Why a command was limited or refused, in the order in which the gate checks."""

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


class LinkState(StrEnum):
    """Whether a robot can be moved through its link."""

    WAITING = "waiting"
    READY = "ready"
    LOST = "lost"
    FAULTED = "faulted"


@dataclass(frozen=True, slots=True)
class Reason:
    """One cause that bound a command, with its numbers.

    Attributes:
        cause: Which check.
        text: One sentence for people.
        joint: The joint's name, where a joint bound the command.
        pair: The names of the two bodies, where clearance did.
        value: What was asked for or found (rad, m, ticks; by cause).
        bound: What it was held against.
        points: The witness points on both bodies, world frame, m.
    """

    cause: Cause
    text: str
    joint: str | None = None
    pair: tuple[str, str] | None = None
    value: float | None = None
    bound: float | None = None
    points: tuple[Point, Point] | None = None


# --- plans: what a link holds and plays -------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class PlanKey:
    """What a plan is compared with before it replaces the held one (compare-and-swap).

    Attributes:
        start: The daemon's start id.
        resets: How often this robot was rebased since that start.
        target: The tick at which the plan's first increment is to be played.
        last_played: The index of the last increment played of the plan that it replaces, -1 for none.
    """

    start: str
    resets: int
    target: int
    last_played: int


@dataclass(frozen=True, slots=True)
class Plan:
    """Increments for the coming ticks of one robot that end at rest."""

    robot: str
    key: PlanKey
    seq: int
    increments: tuple[Joints, ...]


@dataclass(frozen=True, slots=True)
class PlanAnswer:
    """A link's answer to a plan: taken, or not and why (``late``, ``early``, ``mismatch``, ``inactive``)."""

    robot: str
    key: PlanKey
    accepted: bool
    reason: str = ""


# --- events: what the gate is told ------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Tick:
    """One cycle of one robot's clock.

    Attributes:
        robot: Its name.
        tick: Number of the cycle since the daemon's start.
        time: Daemon time of the cycle, s.
        q: Measured position at the cycle, before the increment below took effect.
        setpoint: Commanded position after the increment below.
        increment: What was played at this tick, zeros at rest.
        plan: The plan that it came from; None if the robot has no plan or has played it out.
        index: Index of the increment in that plan, -1 for none.
        rebased: The robot held its last value instead of the plan's: ``setpoint`` is where it was held.
    """

    robot: str
    tick: int
    time: float
    q: Joints
    setpoint: Joints
    increment: Joints
    plan: PlanKey | None = None
    index: int = -1
    rebased: bool = False


@dataclass(frozen=True, slots=True)
class Command:
    """A wish: the increment ``dq`` to the setpoint at the robot's next tick."""

    robot: str
    fence: int
    seq: int
    based_on: int
    dq: Joints


@dataclass(frozen=True, slots=True)
class LeaseChange:
    """Who may command a robot: the holder's fence (None: nobody) and speed bound, a share of the cell's."""

    robot: str
    fence: int | None
    speed: float = 1.0


@dataclass(frozen=True, slots=True)
class Stop:
    """Bring the named robots to rest along their plans and refuse commands until a reset."""

    robots: tuple[str, ...]
    reason: str
    by: str


@dataclass(frozen=True, slots=True)
class Reset:
    """Lift the stop of this id."""

    stop: int
    by: str


@dataclass(frozen=True, slots=True)
class LinkChange:
    """A link became ready, or was lost."""

    robot: str
    state: LinkState
    reason: str = ""


GateEvent = Tick | Command | PlanAnswer | LeaseChange | Stop | Reset | LinkChange


# --- outputs: what the gate answers -----------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Verdict:
    """The judgement of one command.

    Attributes:
        robot: Its name.
        seq: The command's number.
        based_on: The tick that the command was based on.
        target: The tick at which the increment is to be played; None if it was refused before the gate.
        outcome: Admitted, limited or refused.
        beta: The blend between the braking increment (0) and the wish (1).
        dq: The admitted increment; what the robot does if nothing else comes.
        setpoint: The setpoint that it leads to.
        reasons: What bound it; empty if admitted.
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


@dataclass(frozen=True, slots=True)
class Stopped:
    """A stop is in force: a reset names its id. ``replaces`` is the id whose place it takes, if any."""

    id: int
    robots: tuple[str, ...]
    reason: str
    by: str
    replaces: int | None = None


@dataclass(frozen=True, slots=True)
class ResetAnswer:
    """A stop was lifted, or not and why (``unknown``, ``moving``).

    Attributes:
        stop: The id that the reset named.
        accepted: True if the stop was lifted.
        reason: Why not.
        lifted: The id that was in force, if it had replaced ``stop``.
    """

    stop: int
    accepted: bool
    reason: str = ""
    lifted: int | None = None


@dataclass(frozen=True, slots=True)
class Rebase:
    """The link shall drop its plan and take ``setpoint`` as commanded; ``resets`` is the new count."""

    robot: str
    setpoint: Joints
    resets: int


GateOutput = Verdict | Plan | Stopped | ResetAnswer | Rebase


# --- what the gate can tell about a robot, for the state ---------------------------------------------------


@dataclass(frozen=True, slots=True)
class Nearest:
    """How near two bodies are at the measured positions.

    ``distance`` is a certified lower bound; ``points`` are the witness points (world frame, m) where an
    engine was asked, None where only the bound is known.
    """

    pair: tuple[str, str]
    distance: float
    limit: float
    points: tuple[Point, Point] | None
