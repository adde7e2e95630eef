"""Comparison of the cell that the daemon describes with the configuration that the monitor was given."""

from collections.abc import Callable, Iterator

import numpy as np

from armgate.client import Body, Description, RobotDescription
from armgate.monitor import tolerances as tol
from armgate.monitor.errors import DescriptionError
from armgate.monitor.frames import Array, from_quaternion
from armgate.monitor.joints import joint_differences
from armgate.monitor.model import Cell, CellBody, Robot
from armgate.monitor.solids import primitive

Assets = Callable[[str], bytes]
"""Returns what the description names by this hash; raises DescriptionError if that is not to be had."""


def orders_of(description: Description) -> dict[str, list[str]]:
    """Return the names of the joints of each robot, in the order of the states."""
    return {robot.name: [joint.name for joint in robot.joints] for robot in description.robots}


def differences(cell: Cell, description: Description, assets: Assets) -> list[str]:
    """Return what the daemon describes otherwise than the configuration, one text each."""
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
        yield f"{what} is described as {given:.9g}; the configuration says {mine:.9g}"


def _robot(robot: Robot, d: RobotDescription) -> Iterator[str]:
    yield from _number(f"{robot.name}: period", robot.period, d.period)
    yield from _place(f"{robot.name}: base", robot.base, from_quaternion(d.base_xyz, d.base_xyzw))
    for i, joint in enumerate(d.joints):
        name = f"{robot.name}: {joint.name}"
        kind = "revolute" if robot.revolute[i] else "prismatic"
        if joint.kind != kind:
            yield f"{name} is described as {joint.kind}; the configuration says {kind}"
        for key in ("lower", "upper", "velocity", "acceleration", "deceleration"):
            yield from _number(f"{name}: {key}", float(getattr(robot, key)[i]), getattr(joint, key))


def _place(what: str, mine: Array, theirs: Array) -> Iterator[str]:
    off = float(np.abs(mine - theirs).max())
    if off > tol.DESCRIBED:
        yield f"{what} is described elsewhere than configured, by {off:.3g}"


def _bodies(cell: Cell, d: Description) -> Iterator[str]:
    mine = {body.name: body for body in cell.bodies}
    theirs = {_whole(body): body for body in d.bodies}
    for name in sorted(set(mine) ^ set(theirs)):
        known = "configured but not described" if name in mine else "described but not configured"
        yield f"body {name} is {known}"
    for name in sorted(set(mine) & set(theirs)):
        yield from _body(mine[name], theirs[name])


def _whole(body: Body) -> str:
    """Return the name of the body that a part of a mesh belongs to."""
    parts = body.name.split("/")
    return "/".join(parts[: 1 if body.robot is None else 2])


def _body(mine: CellBody, theirs: Body) -> Iterator[str]:
    if mine.link != (theirs.link or ""):
        yield f"body {mine.name} is described on link {theirs.link}; the configuration says {mine.link}"
    if mine.meshed or (theirs.exact is not None and theirs.exact.kind != "cone"):
        return  # its parts are the daemon's own choice
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
