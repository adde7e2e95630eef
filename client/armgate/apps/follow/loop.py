"""The follower's loop: leader's position in, one increment out, at each tick of the camera's robot."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from armgate.apps.errors import AppError, UsageError
from armgate.apps.follow.proximity import Proximity, RobotBodies
from armgate.apps.increments import LastIncrement
from armgate.apps.interrupt import Interrupt
from armgate.apps.robot_models import bounds_of, described, floor_of, model_of
from armgate.apps.sharing import Sharing
from armgate.client import Cell, Robot, RobotDescription, SignalValue, Tick
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
DISTANCES = (0.05, 100.0)
"""View distances that make sense, m."""

NEAR_LIMIT = 0.95
"""A joint that is farther than this share of its half range from its middle is near a limit."""


@dataclass(frozen=True)
class FollowOptions:
    """How to follow.

    Attributes:
        distance: Wanted view distance unless a signal says another, m.
        lag: Known lag of the camera's robot behind its setpoint, s.
        focus: A fixed place to look at instead of the leader's tool, world, m.
        predict: Whether to look at where the tool will be, or at where it was measured.
    """

    distance: float
    lag: float
    focus: tuple[float, float, float] | None = None
    predict: bool = True


@dataclass
class FollowLoop:
    """What the follower needs at each tick.

    Attributes:
        robot: The robot that carries the camera, as described.
        leader: The robot whose tool is looked at, as described.
        proximity: Finds where the leader, whose model it holds, is near.
        spheres: The leader's bounding spheres, which repel.
        follower: The control law with its bounds.
        bounds: Of the camera robot's increments.
        options: How to follow.
        floor: Height of the floor, which repels too, m; None for none.
    """

    robot: RobotDescription
    leader: RobotDescription
    proximity: Proximity
    spheres: Spheres
    follower: Follower
    bounds: IncrementBounds
    options: FollowOptions
    floor: float | None
    _last: LastIncrement = field(default_factory=LastIncrement)
    _zoomed: float | None = None

    @classmethod
    def build(cls, cell: Cell, robot: str, leader: str, options: FollowOptions) -> "FollowLoop":
        """From what the daemon describes.

        Raises:
            UsageError: A robot is unknown, or the one that shall follow has no camera.
        """
        own, other = described(cell.description, robot), described(cell.description, leader)
        if own.camera is None:
            raise UsageError(f"robot {robot!r} has no camera; name one in the cell's configuration")
        if robot == leader:
            raise UsageError(f"robot {robot!r} cannot follow itself; name another --leader")
        carrier, target = model_of(cell, own), model_of(cell, other)
        bounds = bounds_of(own)
        follower = Follower(
            camera_law(carrier, own.camera),
            bounds,
            period=own.period,
            ahead=LOOP_TICKS * own.period + ramp_lag(options.lag, own.period),
            predict=options.predict,
        )
        proximity = Proximity(RobotBodies.of(robot, carrier), RobotBodies.of(leader, target))
        return cls(
            own, other, proximity, Spheres.of(target), follower, bounds, options, floor_of(cell.description)
        )

    def step(self, tick: Tick) -> "Answer":
        """The answer to a tick."""
        own, entry = tick.entry(self.robot.name), tick.entry(self.leader.name)
        played = self._last.update(tick.tick, tick.setpoint)
        distance = self._distance(tick)
        leader = None if entry.q is None else np.array(entry.q)
        focus, seen = self._focus(leader, tick.time, entry.time)
        q = np.array(tick.q)
        now = Situation(
            time=tick.time,
            setpoint=np.array(tick.setpoint),
            last=played,
            q=q,
            target=focus,
            target_time=seen,
            distance=distance,
            obstacles=self._obstacles(leader),
            stop_end=np.array(own.stop_end) if own.stop_end else None,
            near=self.proximity.pairs(own, entry),
        )
        near = self.bounds.share(q) > NEAR_LIMIT
        tool = None if self.options.focus is None else self._tool(leader)
        return Answer(self.follower.step(now), played, distance, focus, near, tool)

    def told(self, tick: Tick) -> tuple[SignalValue | None, str | None]:
        """Return the signal of the leader's progress, and the name of the client that holds its robot."""
        return tick.signals.get("lead.progress"), tick.entry(self.leader.name).holder

    def _distance(self, tick: Tick) -> float:
        """The wanted view distance: while there is an operator, the last of theirs that makes sense."""
        told = tick.signals.get("operator.distance")
        if told is None:
            self._zoomed = None
        elif DISTANCES[0] <= told.value[0] <= DISTANCES[1]:
            self._zoomed = told.value[0]
        return self.options.distance if self._zoomed is None else self._zoomed

    def _focus(self, leader: Array | None, now: float, measured: float) -> tuple[Array | None, float]:
        """Where to look, and since when that is known."""
        if self.options.focus is not None:
            return np.array(self.options.focus), now
        return self._tool(leader), measured

    def _tool(self, leader: Array | None) -> Array | None:
        return None if leader is None else self.proximity.other.model.frame(leader, self.leader.tool).t

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
        focus: The measured place that is looked at (3,), world, m; None if it is not known.
        near_limit: Whether a joint is near its limit.
        leader: The measured place of the leader's tool (3,), world, m, where that is not looked at.
    """

    step: FollowStep
    played: Array
    distance: float
    focus: Array | None
    near_limit: bool
    leader: Array | None = None

    def signals(self) -> dict[str, tuple[float, ...]]:
        """What others may want to know of it; nothing before the leader's place is known."""
        if self.step.angle is None or self.step.distance is None or self.focus is None:
            return {}
        leader = {} if self.leader is None else {"follow.leader": tuple(self.leader.tolist())}
        return leader | {
            "follow.angle_error": (self.step.angle,),
            "follow.distance_error": (self.step.distance,),
            "follow.focus": tuple(self.focus.tolist()),
            "follow.distance": (self.distance,),
            "follow.repulsion": (float(self.step.repulsion),),
            "follow.emergency": (float(self.step.emergency),),
            "follow.near_limit": (float(self.near_limit),),
        }


def follow_leader(
    sharing: Sharing, robot: Robot, loop: FollowLoop, interrupt: Interrupt, duration: float | None
) -> str:
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
        told = share_changes(sharing, answer.signals(), told)
        if ending is None:
            over = duration is not None and tick.time - begin >= duration
            ending = (
                "interrupted"
                if interrupt.requested
                else "time is over"
                if over
                else watched.ending(*loop.told(tick))
            )
        robot.send((answer.step.dq if ending is None else loop.bounds.braked(answer.played)).tolist())
    if watched.left:
        raise AppError(
            f"{loop.robot.name} is at rest: the leader left at {100 * watched.value:.0f} % of its path"
        )
    return f"{ending}, at rest"


@dataclass
class Progress:
    """What is known of the leader's path.

    Only what the holder of the leader's robot shares counts, and only from 0 to 1: any client may take the
    signal's name first.

    Attributes:
        value: The newest progress, 0 to 1.
        left: True if the leader is gone although its path was not done.
    """

    value: float = 0.0
    left: bool = False
    _owner: str | None = None

    def ending(self, told: SignalValue | None, holder: str | None) -> str | None:
        """Return why to end, None to go on. A leader that never shares its progress is followed without end.

        Args:
            told: The signal of the progress.
            holder: Name of the client that holds the leader's robot.
        """
        if told is not None and told.owner == holder:
            self._owner = holder
        if self._owner is None:
            return None
        if told is None or told.owner != self._owner:
            self.left = True
            return "the leader is gone"
        if 0.0 <= told.value[0] <= 1.0:
            self.value = told.value[0]
        return "the leader's path is done" if self.value >= 1.0 else None


def share_changes(
    sharing: Sharing, values: dict[str, tuple[float, ...]], told: dict[str, tuple[float, ...]]
) -> dict[str, tuple[float, ...]]:
    """Share what is new; return what is shared now."""
    for name, value in values.items():
        if told.get(name) != value:
            sharing.share(name, value)
    return {**told, **values}
