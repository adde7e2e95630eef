"""The follower's loop: leader's position in, one increment out, at each tick of the camera's robot."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from armgate.apps.errors import AppError, UsageError
from armgate.apps.increments import LastIncrement
from armgate.apps.interrupt import Interrupt
from armgate.cell.model import RobotModel
from armgate.cell.placement import Placement
from armgate.client import Cell, Description, Robot, RobotDescription, Tick
from armgate.control.bounds import IncrementBounds
from armgate.control.compiled import camera_law
from armgate.control.follower import Follower, FollowStep, Situation
from armgate.control.predict import ramp_lag
from armgate.control.repulsion import Obstacles
from armgate.control.spheres import Spheres

Array = NDArray[np.float64]

LOOP_TICKS = 2
"""Ticks from a measured position to the measured effect of the increment that answers it."""
AT_REST = 1e-9
"""An increment below this is rest, rad or m."""


@dataclass
class FollowLoop:
    """What the follower needs at each tick.

    Attributes:
        robot: The robot that carries the camera, as described.
        leader: The robot whose tool is looked at, as described.
        target: Model of the leader's robot.
        spheres: Its bounding spheres, which repel.
        follower: The control law with its bounds.
        bounds: Of the camera robot's increments.
        distance: Wanted view distance unless a signal says another, m.
        floor: Height of the floor, which repels too, m; None for none.
    """

    robot: RobotDescription
    leader: RobotDescription
    target: RobotModel
    spheres: Spheres
    follower: Follower
    bounds: IncrementBounds
    distance: float
    floor: float | None
    _last: LastIncrement = field(default_factory=LastIncrement)

    @classmethod
    def build(cls, cell: Cell, robot: str, leader: str, distance: float, lag: float) -> "FollowLoop":
        """From what the daemon describes.

        Raises:
            UsageError: A robot is unknown, or the one that shall follow has no camera.
        """
        own, other = described(cell.description, robot), described(cell.description, leader)
        if own.camera is None:
            raise UsageError(f"robot {robot!r} has no camera; name one in the cell's configuration")
        if robot == leader:
            raise UsageError(f"robot {robot!r} cannot follow itself; name another --leader")
        target = model_of(cell, other)
        bounds = bounds_of(own)
        follower = Follower(
            camera_law(model_of(cell, own), own.camera),
            bounds,
            period=own.period,
            ahead=LOOP_TICKS * own.period + ramp_lag(lag, own.period),
        )
        return cls(
            own, other, target, Spheres.of(target), follower, bounds, distance, floor_of(cell.description)
        )

    def step(self, tick: Tick) -> "Answer":
        """The answer to a tick."""
        entry = tick.entry(self.leader.name)
        played = self._last.update(tick.tick, tick.setpoint)
        wanted = tick.signals.get("operator.distance")
        distance = self.distance if wanted is None else wanted.value[0]
        q = None if entry.q is None else np.array(entry.q)
        focus = None if q is None else self.target.frame(q, self.leader.tool).t
        now = Situation(
            time=tick.time,
            setpoint=np.array(tick.setpoint),
            last=played,
            q=np.array(tick.q),
            target=focus,
            target_time=entry.time,
            distance=distance,
            obstacles=self._obstacles(q),
        )
        return Answer(self.follower.step(now), played, distance, focus)

    def _obstacles(self, q: Array | None) -> Obstacles:
        if q is None:
            return Obstacles(floor=self.floor)
        return Obstacles(self.spheres.centres(q), self.spheres.radii, self.floor)


@dataclass(frozen=True)
class Answer:
    """What the follower makes of a tick.

    Attributes:
        step: What the control law wants, with the errors at the measured positions.
        played: The increment that the robot played last (n,).
        distance: The wanted view distance, m.
        focus: The measured place of the leader's tool (3,), world, m; None if it is not known.
    """

    step: FollowStep
    played: Array
    distance: float
    focus: Array | None

    def signals(self) -> dict[str, tuple[float, ...]]:
        """What others may want to know of it; nothing before the leader's place is known."""
        if self.step.angle is None or self.step.distance is None or self.focus is None:
            return {}
        return {
            "follow.angle_error": (self.step.angle,),
            "follow.distance_error": (self.step.distance,),
            "follow.focus": tuple(self.focus.tolist()),
            "follow.distance": (self.distance,),
            "follow.repulsion": (float(self.step.repulsion),),
        }


def floor_of(cell: Description) -> float | None:
    """Height of the floor: the top of the body of this name, if it is a level box; m."""
    for body in cell.bodies:
        if (
            body.robot is None
            and body.name == "floor"
            and body.shape.kind == "box"
            and not any(body.xyzw[:2])
        ):
            return body.xyz[2] + body.shape.size[2] / 2
    return None


def described(cell: Description, robot: str) -> RobotDescription:
    """The description of a robot.

    Raises:
        UsageError: There is none of this name.
    """
    for found in cell.robots:
        if found.name == robot:
            return found
    known = ", ".join(found.name for found in cell.robots)
    raise UsageError(f"cell {cell.name!r} has no robot {robot!r}; it has {known}")


def model_of(cell: Cell, robot: RobotDescription) -> RobotModel:
    """The robot's model, from its URDF and the place of its base."""
    return RobotModel.from_urdf(
        cell.urdf(robot.name), Placement.from_quaternion(robot.base_xyz, robot.base_xyzw)
    )


def bounds_of(robot: RobotDescription) -> IncrementBounds:
    """Bounds of its increments, as the gate applies them."""
    joints = robot.joints
    return IncrementBounds.from_rates(
        lower=[joint.lower for joint in joints],
        upper=[joint.upper for joint in joints],
        velocity=[joint.velocity for joint in joints],
        acceleration=[joint.acceleration for joint in joints],
        deceleration=[joint.deceleration or np.inf for joint in joints],
        period=robot.period,
    )


def chase(cell: Cell, robot: Robot, loop: FollowLoop, wish: Interrupt, duration: float | None) -> str:
    """Follows until the leader is done, the time is over, or somebody asks to end; then slows to rest.

    Returns:
        How it ended, in words.

    Raises:
        AppError: The leader left before its path was done; the robot is at rest.
        Lost: The lease was lost or the robot stopped.
        ConnectionLost: The daemon is gone.
    """
    begin: float | None = None
    ending: str | None = None
    watched = Progress()
    told: dict[str, tuple[float, ...]] = {}
    for tick in robot.ticks():
        begin = tick.time if begin is None else begin
        answer = loop.step(tick)
        if ending is not None and np.all(np.abs(answer.played) < AT_REST):
            break
        told = tell_changes(cell, answer.signals(), told)
        if ending is None:
            over = duration is not None and tick.time - begin >= duration
            ending = "interrupted" if wish.asked else "time is over" if over else watched.ending(tick)
        robot.send((answer.step.dq if ending is None else loop.bounds.braked(answer.played)).tolist())
    if watched.left:
        raise AppError(
            f"{loop.robot.name} is at rest: the leader left at {100 * watched.value:.0f} % of its path"
        )
    return f"{ending}, at rest"


@dataclass
class Progress:
    """What is known of the leader's path.

    Attributes:
        value: The newest progress, 0 to 1.
        left: Whether the leader is gone although its path was not done.
    """

    value: float = 0.0
    left: bool = False
    _seen: bool = False

    def ending(self, tick: Tick) -> str | None:
        """Why to end, None to go on. A leader that never tells its progress is followed without end."""
        told = tick.signals.get("lead.progress")
        if told is None:
            self.left = self._seen
            return "the leader is gone" if self._seen else None
        self._seen, self.value = True, told.value[0]
        return "the leader's path is done" if self.value >= 1.0 else None


def tell_changes(
    cell: Cell, values: dict[str, tuple[float, ...]], told: dict[str, tuple[float, ...]]
) -> dict[str, tuple[float, ...]]:
    """Shares what is new; what was told before stays known to everybody."""
    for name, value in values.items():
        if told.get(name) != value:
            cell.signal(name, value)
    return {**told, **values}
