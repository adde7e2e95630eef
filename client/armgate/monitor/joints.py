"""Comparison of the joints in the URDF that the daemon describes with those that the monitor read itself."""

from collections.abc import Iterator, Sequence

import numpy as np

from armgate.monitor import tolerances as tol
from armgate.monitor.errors import DescriptionError
from armgate.monitor.frames import Array, roll_pitch_yaw
from armgate.monitor.model import Robot
from armgate.monitor.urdf_file import Joint, read_joints

_ADVICE = "start the daemon and the monitor with the same URDF and configuration"


def joint_differences(robot: Robot, urdf: bytes) -> Iterator[str]:
    """Yield one text for each joint, moving or fixed, that the described URDF has otherwise.

    Args:
        robot: The robot by the monitor's own reading.
        urdf: The text that the daemon describes: with gantry and frames, in UTF-8.
    """
    try:
        described = {joint.name: joint for joint in read_joints(urdf)}
    except DescriptionError as error:
        yield f"{robot.name}: the described URDF cannot be read: {error}; {_ADVICE}"
        return
    own = {joint.name: joint for joint in robot.chain}
    for name in sorted(set(own) ^ set(described)):
        known = "configured but not described" if name in own else "described but not configured"
        yield f"{robot.name}: joint {name} is {known} in the URDF; {_ADVICE}"
    for name, joint in own.items():
        if name in described and (parts := list(_parts(joint, described[name]))):
            yield f"{robot.name}: joint {name} is described with {'; and with '.join(parts)}; {_ADVICE}"


def _parts(mine: Joint, theirs: Joint) -> Iterator[str]:
    """Yield what differs, each with the described and the configured value."""
    for what in ("kind", "parent", "child"):
        given, expected = getattr(theirs, what), getattr(mine, what)
        if given != expected:
            yield f"the {what} {given}, the configuration says {expected}"
    if not np.abs(mine.origin - theirs.origin).max() <= tol.DESCRIBED:
        yield f"the origin {_place(theirs.origin)}, the configuration says {_place(mine.origin)}"
    moves = "fixed" not in (mine.kind, theirs.kind)
    if moves and not np.abs(mine.axis - theirs.axis).max() <= tol.DESCRIBED:
        yield f"the axis {_numbers(theirs.axis)}, the configuration says {_numbers(mine.axis)}"


def _place(origin: Array) -> str:
    return f"xyz {_numbers(origin[:3, 3])} m, rpy {_numbers(roll_pitch_yaw(origin))} rad"


def _numbers(values: Sequence[float] | Array) -> str:
    return " ".join(f"{value + 0.0:.9g}" for value in values)
