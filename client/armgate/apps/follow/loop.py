"""Loop of the follower: it sends one increment per tick of the camera's robot, from the leader's position."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from armgate.apps.errors import AppError, UsageError
from armgate.apps.follow.proximity import Proximity, RobotBodies
from armgate.apps.interrupt import Interrupt
from armgate.apps.last_increment import LastIncrement
from armgate.apps.robot_models import bounds_of, described, floor_of, model_of
from armgate.apps.shared_signals import SharedSignals
from armgate.client import Cell, Robot, RobotDescription, SignalValue, Tick
from armgate.control.bounds import IncrementBounds
from armgate.control.compiled import camera_law
from armgate.control.follower import Follower, FollowStep, Situation
from armgate.control.predict import ramp_lag
from armgate.control.repulsion import Obstacles
from armgate.control.spheres import Spheres

Array = NDArray[np.float64]

LOOP_TICKS = 2
"""Ticks from a measurement until the effect of the increment based on it is measured."""
AT_REST = 1e-9
"""Increment below which the robot is at rest, rad or m."""
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
        spheres: Bounding spheres of the leader, which repel the follower.
        follower: Control law with its bounds.
        bounds: Bounds of the camera robot's increments.
        options: Options of the follower.
        floor: Height of the floor, which also repels, m; None without a floor.
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
        return cls(
            own, other, proximity, Spheres.of(target), follower, bounds, options, floor_of(cell.description)
        )

    def step(self, tick: Tick) -> "FollowOutput":
        """Return the output for a tick."""
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
        return FollowOutput(self.follower.step(now), played, distance, focus, near, tool)

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

    def _focus(self, leader: Array | None, now: float, measured: float) -> tuple[Array | None, float]:
        """Return the point to aim at, and the time at which it was measured."""
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
class FollowOutput:
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


def follow_leader(
    sharing: SharedSignals, robot: Robot, loop: FollowLoop, interrupt: Interrupt, duration: float | None
) -> str:
    """Follow until the leader has finished, the duration has passed or the process is interrupted.

    Returns:
        The outcome in words.

    Raises:
        AppError: The leader disconnected before its path was finished; the robot is at rest.
        Lost: The lease was lost or the robot was stopped.
        ConnectionLost: The connection to the daemon was lost.
    """
    begin: float | None = None
    ending: str | None = None
    watched = Progress()
    shared: dict[str, tuple[float, ...]] = {}
    for tick in robot.ticks():
        begin = tick.time if begin is None else begin
        output = loop.step(tick)
        if ending is not None and np.all(np.abs(output.played) < AT_REST):
            break
        shared = share_changes(sharing, output.signals(), shared)
        if ending is None:
            over = duration is not None and tick.time - begin >= duration
            ending = (
                "interrupted"
                if interrupt.requested
                else "duration has passed"
                if over
                else watched.ending(*loop.leader_progress(tick))
            )
        robot.send((output.step.dq if ending is None else loop.bounds.braked(output.played)).tolist())
    if watched.left:
        raise AppError(
            f"{loop.robot.name} is at rest: the leader disconnected at {100 * watched.value:.0f} % "
            "of its path"
        )
    return f"{ending}, at rest"


@dataclass
class Progress:
    """Progress of the leader's path.

    Only values shared by the holder of the leader's robot count, and only from 0 to 1: any client may
    have shared a signal of this name before.

    Attributes:
        value: Newest progress, 0 to 1.
        left: True if the leader disconnected before its path was finished.
    """

    value: float = 0.0
    left: bool = False
    _owner: str | None = None

    def ending(self, signal: SignalValue | None, holder: str | None) -> str | None:
        """Return the reason to end; None to continue, also if the leader has never shared its progress.

        Args:
            signal: Signal of the progress.
            holder: Name of the client that holds the leader's robot.
        """
        if signal is not None and signal.owner == holder:
            self._owner = holder
        if self._owner is None:
            return None
        if signal is None or signal.owner != self._owner:
            self.left = True
            return "the leader has disconnected"
        if 0.0 <= signal.value[0] <= 1.0:
            self.value = signal.value[0]
        return "the leader's path is finished" if self.value >= 1.0 else None


def share_changes(
    sharing: SharedSignals, values: dict[str, tuple[float, ...]], shared: dict[str, tuple[float, ...]]
) -> dict[str, tuple[float, ...]]:
    """Share values that changed; return all shared values."""
    for name, value in values.items():
        if shared.get(name) != value:
            sharing.share(name, value)
    return {**shared, **values}
