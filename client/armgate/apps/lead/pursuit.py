"""Pursuit: a leader whose tool moves towards a body of another robot, which must evade it."""

from collections.abc import Callable
from dataclasses import dataclass, replace

from armgate.apps.errors import UsageError
from armgate.apps.lead.jog import JogProgram
from armgate.apps.lead.manual import described_in, steering_of
from armgate.apps.lead.motions import Array, MotionRequest, RobotState, ToolTarget
from armgate.apps.robot_models import described, model_of
from armgate.cell.model import RobotModel
from armgate.cell.placement import Placement
from armgate.client.program import ProgramCell, ProgramContext, ignore
from armgate.control.spheres import Spheres


@dataclass(frozen=True)
class TargetBody:
    """Body of another robot.

    Attributes:
        robot: The robot's name.
        spheres: Bounding spheres of that robot.
        which: Indices of the body's spheres.
    """

    robot: str
    spheres: Spheres
    which: tuple[int, ...]

    @classmethod
    def of(cls, robot: str, body: str, model: RobotModel) -> "TargetBody":
        """Return the body with this name.

        Raises:
            UsageError: The robot has no moving body with this name.
        """
        spheres = Spheres.of(model)
        names = [model.bodies[index].name for index in spheres.bodies]
        which = tuple(k for k, name in enumerate(names) if name == body)
        if not which:
            known = ", ".join(dict.fromkeys(names))
            raise UsageError(f"robot {robot!r} has no moving body {body!r}; it has {known}")
        return cls(robot, spheres, which)

    def place(self, q: Array) -> Array:
        """Return the centre of the body (3,) at q (n,), world, m."""
        middle: Array = self.spheres.centres(q)[list(self.which)].mean(axis=0)
        return middle


class Pursuit:
    """Input that moves the tool to the target body and keeps the tool's orientation.

    Args:
        target: The body to pursue.
        model: The leader's model.
        tool: Name of the leader's tool frame.
    """

    def __init__(self, target: TargetBody, model: RobotModel, tool: str) -> None:
        self._target, self._model, self._tool = target, model, tool
        self._R: Array | None = None

    def request(self, state: RobotState) -> MotionRequest:
        """Return a motion towards the measured position of the target; rest while it is unknown."""
        q = state.others.get(self._target.robot)
        if self._R is None:
            self._R = self._model.frame(state.setpoint, self._tool).R
        return (
            MotionRequest()
            if q is None
            else MotionRequest(ToolTarget(Placement(self._R, self._target.place(q))))
        )

    def close(self) -> None:
        """Do nothing: there is no device to close."""


def pursuit_program(
    cell: ProgramCell, robot: str | None, target: str, speed: float, report: Callable[[str], object]
) -> JogProgram:
    """Return the program that pursues a body (``FR/link_3``) at ``speed`` m/s until an end is requested.

    Raises:
        UsageError: The cell has no such robot or body.
    """
    own = described_in(cell.description, robot)
    steering = replace(steering_of(cell, own, 1.0), tool_speed=speed)
    name, _, body = target.partition("/")
    pursued = TargetBody.of(name, body, model_of(cell, described(cell.description, name)))
    return JogProgram(Pursuit(pursued, model_of(cell, own), own.tool), steering, report)


def make(context: ProgramContext, *, target: str, speed: float = 0.25) -> JogProgram:
    """Make the program that pursues a body (``FR/link_3``) at ``speed`` m/s; it prints nothing.

    Raises:
        UsageError: The cell has no such robot or body.
        BadArgument: No robot was named.
    """
    return pursuit_program(context.cell, context.own, target, speed, ignore)
