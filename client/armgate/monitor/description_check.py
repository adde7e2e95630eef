"""Comparison of the cell that the daemon describes with the configuration that the monitor reads itself."""

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from armgate.client import Body, Description, RobotDescription
from armgate.monitor import tolerances as tol
from armgate.monitor.convex_solid import primitive
from armgate.monitor.errors import DescriptionError
from armgate.monitor.model import Cell, CellBody, Robot
from armgate.monitor.transforms import Array, from_quaternion, roll_pitch_yaw
from armgate.monitor.urdf_file import Joint, read_joints

_ADVICE = "start the daemon and the monitor with the same URDF and configuration"

Assets = Callable[[str], bytes]
"""Function that returns the file with this hash; raises DescriptionError if the file is not available."""


def joint_orders(description: Description) -> dict[str, list[str]]:
    """Return the names of the joints of each robot, in the order of the states."""
    return {robot.name: [joint.name for joint in robot.joints] for robot in description.robots}


def differences(cell: Cell, description: Description, assets: Assets) -> list[str]:
    """Return the differences between the described cell and the configuration, one text each."""
    return list(_differences(cell, description, assets))


def _differences(cell: Cell, d: Description, assets: Assets) -> Iterator[str]:
    yield from _number("stop_distance", cell.stop_distance, d.stop_distance)
    yield from _number("self_distance", cell.self_distance, d.self_distance)
    mine, theirs = [robot.name for robot in cell.robots], [robot.name for robot in d.robots]
    if mine != theirs:
        yield f"robots: {', '.join(theirs)} are described; the configuration has {', '.join(mine)}"
        return
    for robot, described in zip(cell.robots, d.robots, strict=True):
        yield from _robot(robot, described)
        try:
            yield from joint_differences(robot, assets(described.urdf.hash))
        except DescriptionError as error:
            yield f"{robot.name}: the joints cannot be compared: {error}"
    yield from _bodies(cell, d)


def _number(what: str, mine: float, theirs: float | None) -> Iterator[str]:
    given = np.inf if theirs is None else theirs
    if given != mine and not abs(given - mine) <= tol.DESCRIBED * max(1.0, abs(mine)):
        yield f"{what} is described as {given:.9g}; configured as {mine:.9g}"


def _robot(robot: Robot, d: RobotDescription) -> Iterator[str]:
    yield from _number(f"{robot.name}: period", robot.period, d.period)
    yield from _place(f"{robot.name}: base", robot.base, from_quaternion(d.base_xyz, d.base_xyzw))
    for i, joint in enumerate(d.joints):
        name = f"{robot.name}: {joint.name}"
        kind = "revolute" if robot.revolute[i] else "prismatic"
        if joint.kind != kind:
            yield f"{name} is described as {joint.kind}; configured as {kind}"
        for key in ("lower", "upper", "velocity", "acceleration", "deceleration"):
            yield from _number(f"{name}: {key}", float(getattr(robot, key)[i]), getattr(joint, key))


def _place(what: str, mine: Array, theirs: Array) -> Iterator[str]:
    off = float(np.abs(mine - theirs).max())
    if off > tol.DESCRIBED:
        yield f"the described pose of {what} differs from the configured one by {off:.3g}"


def _bodies(cell: Cell, d: Description) -> Iterator[str]:
    mine = {body.name: body for body in cell.bodies}
    theirs = {_body_name(body): body for body in d.bodies}
    for name in sorted(set(mine) ^ set(theirs)):
        known = "configured but not described" if name in mine else "described but not configured"
        yield f"body {name} is {known}"
    for name in sorted(set(mine) & set(theirs)):
        yield from _body(mine[name], theirs[name])


def _body_name(body: Body) -> str:
    """Return the name of the body to which a part of a mesh belongs."""
    parts = body.name.split("/")
    return "/".join(parts[: 1 if body.robot is None else 2])


def _body(mine: CellBody, theirs: Body) -> Iterator[str]:
    if mine.link != (theirs.link or ""):
        yield f"body {mine.name} is described on link {theirs.link}; configured on {mine.link}"
    if mine.meshed or (theirs.exact is not None and theirs.exact.kind != "cone"):
        return  # the daemon chooses its parts itself
    shape = theirs.shape if theirs.exact is None else theirs.exact
    solid = primitive(shape.kind, list(shape.size), mine.name)
    same = solid.points.shape == mine.solid.points.shape and np.allclose(
        np.concatenate([solid.points.ravel(), solid.discs, [solid.radius]]),
        np.concatenate([mine.solid.points.ravel(), mine.solid.discs, [mine.solid.radius]]),
        rtol=0.0,
        atol=tol.DESCRIBED,
    )
    if not same:
        yield f"body {mine.name} is described with another shape or size than configured"
    yield from _place(f"body {mine.name}", mine.local, from_quaternion(theirs.xyz, theirs.xyzw))


# --- joints of the URDF ------------------------------------------------------------------------------------


def joint_differences(robot: Robot, urdf: bytes) -> Iterator[str]:
    """Yield one text for each joint, moving or fixed, that differs in the described URDF.

    Args:
        robot: The robot as the monitor has read it.
        urdf: The described URDF, with gantry and frames, in UTF-8.
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
        if name in described and (parts := list(_joint_parts(joint, described[name]))):
            yield f"{robot.name}: joint {name} is described with {'; and with '.join(parts)}; {_ADVICE}"


def _joint_parts(mine: Joint, theirs: Joint) -> Iterator[str]:
    """Yield the differences of a joint, each with the described and the configured value."""
    for what in ("kind", "parent", "child"):
        given, expected = getattr(theirs, what), getattr(mine, what)
        if given != expected:
            yield f"the {what} {given}, configured as {expected}"
    if not np.abs(mine.origin - theirs.origin).max() <= tol.DESCRIBED:
        yield f"the origin {_origin_text(theirs.origin)}, configured as {_origin_text(mine.origin)}"
    moves = "fixed" not in (mine.kind, theirs.kind)
    if moves and not np.abs(mine.axis - theirs.axis).max() <= tol.DESCRIBED:
        yield f"the axis {_numbers_text(theirs.axis)}, configured as {_numbers_text(mine.axis)}"


def _origin_text(origin: Array) -> str:
    return f"xyz {_numbers_text(origin[:3, 3])} m, rpy {_numbers_text(roll_pitch_yaw(origin))} rad"


def _numbers_text(values: Sequence[float] | Array) -> str:
    return " ".join(f"{value + 0.0:.9g}" for value in values)
