"""Plans, ticks and link states: the values that the daemon and a robot's link exchange."""

from enum import StrEnum

from armgate.events.immutable import event

Joints = tuple[float, ...]
"""One number per joint of one robot, in the order of its model."""


class LinkState(StrEnum):
    """State of a link; a robot can be moved only if its link is ready."""

    WAITING = "waiting"
    READY = "ready"
    LOST = "lost"
    FAULTED = "faulted"


@event(frozen=True, slots=True)
class LinkChange:
    """Change of a link's state."""

    robot: str
    state: LinkState
    reason: str = ""


@event(frozen=True, slots=True)
class PlanKey:
    """Key that a link compares before a plan replaces the plan it holds (compare-and-swap).

    Attributes:
        start: Start id of the daemon.
        resets: Number of rebases of this robot since that start.
        target: Tick at which the first increment of the plan is to be played.
        last_played: Index of the last increment played of the plan to be replaced, -1 for none.
    """

    start: str
    resets: int
    target: int
    last_played: int


@event(frozen=True, slots=True)
class Plan:
    """Increments for the coming ticks of one robot, which end at rest."""

    robot: str
    key: PlanKey
    seq: int
    increments: tuple[Joints, ...]

    def __hash__(self) -> int:
        """Return the hash of the key, which differs for each plan of a robot."""
        return hash(self.key)


@event(frozen=True, slots=True)
class PlanAnswer:
    """Answer of a link to a plan: accepted, or ``late``, ``early``, ``mismatch`` or ``inactive``."""

    robot: str
    key: PlanKey
    accepted: bool
    reason: str = ""


@event(frozen=True, slots=True)
class Rebase:
    """Order to a link: drop the plan and take ``setpoint`` as commanded; ``resets`` is the new count."""

    robot: str
    setpoint: Joints
    resets: int


@event(frozen=True, slots=True)
class Tick:
    """One cycle of one robot's clock.

    Attributes:
        robot: Name of the robot.
        tick: Number of the cycle since the start of the daemon.
        time: Daemon time of the cycle, s.
        q: Measured position at the cycle, before the increment below took effect.
        setpoint: Commanded position after the increment below.
        increment: Increment played at this tick; zeros at rest.
        plan: Key of the plan that contains the increment; None if there is no plan or it has ended.
        index: Index of the increment in that plan, -1 for none.
        rebased: True if the robot held its position instead of following the plan; ``setpoint`` is the held
            position.
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
