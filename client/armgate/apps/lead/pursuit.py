"""A leader that goes for a body of another robot, wherever that moves to: what a follower has to escape."""

from collections.abc import Callable
from dataclasses import dataclass, replace

from armgate.apps.errors import UsageError
from armgate.apps.interrupt import Interrupt
from armgate.apps.lead.manual import described_in, drive_by, steering_of
from armgate.apps.lead.motions import Array, MotionRequest, RobotState, ToolTarget
from armgate.apps.robot_models import described, model_of
from armgate.cell.model import RobotModel
from armgate.cell.placement import Placement
from armgate.client import Cell
from armgate.control.spheres import Spheres


@dataclass(frozen=True)
class TargetBody:
    """A body of another robot.

    Attributes:
        robot: The robot's name.
        spheres: Bounding spheres of the robot.
        which: Those of the body.
    """

    robot: str
    spheres: Spheres
    which: tuple[int, ...]

    @classmethod
    def of(cls, robot: str, body: str, model: RobotModel) -> "TargetBody":
        """A body by its name.

        Raises:
            UsageError: No moving body of the robot has this name.
        """
        spheres = Spheres.of(model)
        names = [model.bodies[index].name for index in spheres.bodies]
        which = tuple(k for k, name in enumerate(names) if name == body)
        if not which:
            known = ", ".join(dict.fromkeys(names))
            raise UsageError(f"robot {robot!r} has no moving body {body!r}; it has {known}")
        return cls(robot, spheres, which)

    def place(self, q: Array) -> Array:
        """The body's middle (3,) at q (n,), world, m."""
        middle: Array = self.spheres.centres(q)[list(self.which)].mean(axis=0)
        return middle


class Pursuit:
    """An input whose tool keeps its posture and wants to be where the target is.

    Args:
        target: What it goes for.
        model: The leader's model.
        tool: Name of its tool's frame.
    """

    def __init__(self, target: TargetBody, model: RobotModel, tool: str) -> None:
        self._target, self._model, self._tool = target, model, tool
        self._R: Array | None = None

    def request(self, state: RobotState) -> MotionRequest:
        """Towards the target as it was measured; rest while its place is not known."""
        q = state.others.get(self._target.robot)
        if self._R is None:
            self._R = self._model.frame(state.setpoint, self._tool).R
        return (
            MotionRequest()
            if q is None
            else MotionRequest(ToolTarget(Placement(self._R, self._target.place(q))))
        )

    def close(self) -> None:
        """Nothing to let go of."""


def pursue(
    cell: Cell,
    robot: str | None,
    target: str,
    speed: float,
    interrupt: Interrupt,
    report: Callable[[str], object],
) -> str:
    """Pursues a body (``FR/link_3``) at ``speed`` m/s until somebody interrupts; returns how it ended.

    Raises:
        UsageError: There is no such robot or body.
        ClientError: The lease was refused or lost, the robot stopped, the daemon is gone.
    """
    own = described_in(cell.description, robot)
    steering = replace(steering_of(cell, own, 1.0), tool_speed=speed)
    name, _, body = target.partition("/")
    target = TargetBody.of(name, body, model_of(cell, described(cell.description, name)))
    source = Pursuit(target, model_of(cell, own), own.tool)
    return drive_by(source, cell, own.name, steering, interrupt, report)
