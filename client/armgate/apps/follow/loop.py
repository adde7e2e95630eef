"""State and models of the follower, which aims a camera at the leader by one increment per tick."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armgate.apps.errors import UsageError
from armgate.apps.follow.proximity import Proximity, RobotBodies
from armgate.apps.last_increment import LastIncrement
from armgate.apps.robot_models import bounds_of, described, floor_of, model_of
from armgate.client import RobotDescription, SignalValue, Tick
from armgate.client.program import ProgramCell
from armgate.control.bounds import IncrementBounds
from armgate.control.compiled import camera_law, leader_of
from armgate.control.follower import Follower, FollowStep, Situation
from armgate.control.leader import Leader
from armgate.control.predict import ramp_lag

Array = NDArray[np.float64]

LOOP_TICKS = 2
"""Ticks from a measurement until the effect of the increment based on it is measured."""
DISTANCES = (0.05, 100.0)
"""Smallest and largest view distance that is accepted, m."""

NEAR_LIMIT = 0.95
"""Share of the half range from the middle beyond which a joint is near its limit."""


@dataclass(frozen=True)
class FollowOptions:
    """Options of the follower.

    Attributes:
        distance: Wanted view distance unless a signal overrides it, m.
        lag: Known lag of the camera's robot behind its setpoint, s.
        focus: Fixed point to aim the camera at instead of the leader's tool, world, m.
        predict: True to aim at the predicted position of the tool, False for the measured one.
    """

    distance: float
    lag: float
    focus: tuple[float, float, float] | None = None
    predict: bool = True


@dataclass
class FollowLoop:
    """State and models of the follower's loop.

    Attributes:
        robot: Description of the robot that carries the camera.
        leader: Description of the robot whose tool the camera is aimed at.
        proximity: Near pairs of bodies; contains the leader's model.
        aimed: The leader's tool, and the spheres and the floor that repel the follower.
        follower: Control law with its bounds.
        bounds: Bounds of the camera robot's increments.
        options: Options of the follower.
    """

    robot: RobotDescription
    leader: RobotDescription
    proximity: Proximity
    aimed: Leader
    follower: Follower
    bounds: IncrementBounds
    options: FollowOptions
    _last: LastIncrement = field(default_factory=LastIncrement)
    _zoomed: float | None = None

    def __post_init__(self) -> None:
        # Positions of each joint that are not near its limits.
        self._inner = list(zip(*(end.tolist() for end in self.bounds.middle(NEAR_LIMIT)), strict=True))

    @classmethod
    def build(cls, cell: ProgramCell, robot: str, leader: str, options: FollowOptions) -> "FollowLoop":
        """Build the loop from the daemon's description.

        Raises:
            UsageError: A robot is unknown, both are the same, or the follower's robot has no camera.
        """
        own, other = described(cell.description, robot), described(cell.description, leader)
        if own.camera is None:
            raise UsageError(f"robot {robot!r} has no camera; configure one in the cell's configuration")
        if robot == leader:
            raise UsageError(f"robot {robot!r} cannot follow itself; choose another --leader")
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
        aimed = leader_of(target, other.tool, floor_of(cell.description))
        return cls(own, other, proximity, aimed, follower, bounds, options)

    def step(self, tick: Tick) -> "FollowOutput":
        """Return the output for a tick."""
        own, entry = tick.entry(self.robot.name), tick.entry(self.leader.name)
        measured = tick.q
        q, setpoint = np.array(measured), np.array(tick.setpoint)
        played = self._last.update(tick.tick, setpoint)
        distance = self._distance(tick)
        tool, obstacles = self.aimed.at(None if entry.q is None else np.array(entry.q))
        focus, seen = self._focus(tool, tick.time, entry.time)
        now = Situation(
            time=tick.time,
            setpoint=setpoint,
            last=played,
            q=q,
            target=focus,
            target_time=seen,
            distance=distance,
            obstacles=obstacles,
            stop_end=np.array(own.stop_end) if own.stop_end else None,
            near=self.proximity.pairs(own, entry),
        )
        near = any(not low <= at <= high for at, (low, high) in zip(measured, self._inner, strict=True))
        shown = None if self.options.focus is None else tool
        return FollowOutput(self.follower.step(now), played, distance, focus, near, shown)

    def leader_progress(self, tick: Tick) -> tuple[SignalValue | None, str | None]:
        """Return the signal of the leader's progress, and the name of the client that holds its robot."""
        return tick.signals.get("lead.progress"), tick.entry(self.leader.name).holder

    def _distance(self, tick: Tick) -> float:
        """Return the wanted view distance: the last valid value of the operator's signal, if it is shared."""
        signal = tick.signals.get("operator.distance")
        if signal is None:
            self._zoomed = None
        elif DISTANCES[0] <= signal.value[0] <= DISTANCES[1]:
            self._zoomed = signal.value[0]
        return self.options.distance if self._zoomed is None else self._zoomed

    def _focus(self, tool: Array | None, now: float, measured: float) -> tuple[Array | None, float]:
        """Return the point to aim at, and the time at which it was measured."""
        if self.options.focus is not None:
            return np.array(self.options.focus), now
        return tool, measured


class FollowOutput(NamedTuple):
    """Output of the follower for one tick: increment, errors and signals.

    Attributes:
        step: Output of the control law, with the errors at the measured positions.
        played: Increment that the robot played last (n,).
        distance: Wanted view distance, m.
        focus: Measured point that the camera is aimed at (3,), world, m; None if it is unknown.
        near_limit: True if a joint is near its limit.
        leader: Measured position of the leader's tool (3,), world, m, if the camera is aimed at another
            point.
    """

    step: FollowStep
    played: Array
    distance: float
    focus: Array | None
    near_limit: bool
    leader: Array | None = None

    def signals(self) -> dict[str, tuple[float, ...]]:
        """Return the signals to share; none before the leader's position is known."""
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
