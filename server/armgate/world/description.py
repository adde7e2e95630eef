"""Description of a cell for clients."""

import math
from collections.abc import Mapping, Sequence
from weakref import WeakKeyDictionary

from armgate.cell.cell import Body, Cell, Robot
from armgate.cell.placement import Placement
from armgate.cell.shapes import Box, Cone, Convex, Cylinder, Shape
from armgate.protocol import LocalProtocolError, encode, with_re
from armgate.protocol import messages as m
from armgate.world.assets import Assets, asset_reference, to_obj

_LARGEST_ID = 2**31 - 1

STOP_REPLACES = "stop.replaces"
"""Capability of servers in which a repeated stop replaces the stop that it repeats.

If a client names this capability too, the daemon refuses its reset of a stop that was replaced.
"""

SESSIONS = "sessions"
"""Capability of servers that list sessions, and end one of them, for operators."""

BODY_EXACT = "body.exact"
"""Capability of servers whose bodies may have an exact shape inside the primitive that contains it."""


class CellDescription:
    """The description of a cell and its assets.

    Attributes:
        description: The description, without the ``re`` of a request.
        frame: Its frame, encoded once: a large one takes longer to encode than a tick may be delayed.
        assets: Assets that it names.

    Args:
        cell: The cell.
        lockstep: True if time passes in lock-step.

    Raises:
        ConfigError: The cell is larger than a description may be; the text names file, line and key.
    """

    def __init__(self, cell: Cell, lockstep: bool) -> None:
        _check_counts(cell)
        meshes = {body.shape: to_obj(body.shape) for body in cell.bodies if isinstance(body.shape, Convex)}
        self.assets = Assets([*(robot.urdf for robot in cell.robots), *meshes.values()])
        self.description = m.Description(
            name=cell.name,
            hash=cell.hash,
            stop_distance=cell.config.stop_distance,
            self_distance=cell.config.self_distance,
            response=cell.config.response,
            lockstep=lockstep,
            robots=tuple(_robot(robot) for robot in cell.robots),
            bodies=tuple(_body(cell, body, meshes) for body in cell.bodies),
        )
        self.frame = self._encoded(cell)

    def _encoded(self, cell: Cell) -> bytes:
        try:
            encode(self.description.model_copy(update={"re": _LARGEST_ID}))
            return encode(self.description)
        except LocalProtocolError as error:
            text = f"the description of this cell is too large: {error.text}; use fewer robots or bodies"
            raise cell.config.error(("robots",), text) from error

    def describe(self, re: int | None) -> tuple[m.Description, bytes]:
        """Return the description as the answer to a request, and its frame."""
        if re is None:
            return self.description, self.frame
        return self.description.model_copy(update={"re": re}), with_re(self.frame, re)


_of_cells: WeakKeyDictionary[Cell, CellDescription] = WeakKeyDictionary()


def lockstep_description(cell: Cell) -> CellDescription:
    """Return the description of a cell in lock-step, which is made once for all worlds restored in a process.

    Raises:
        ConfigError: As for `CellDescription`.
    """
    known = _of_cells.get(cell)
    if known is None:
        known = _of_cells[cell] = CellDescription(cell, lockstep=True)
    return known


def _check_counts(cell: Cell) -> None:
    for robot in cell.robots:
        counts = {
            "joints": (robot.model.n, m.MAX_JOINTS),
            "links": (len(robot.model.frame_names), m.MAX_FRAMES),
        }
        for what, (count, most) in counts.items():
            if count > most:
                text = f"{robot.name} has {count} {what}; expected at most {most}"
                raise cell.config.error(("robots", robot.name, "urdf"), text)
    if len(cell.bodies) > m.MAX_BODIES:
        text = f"the cell has {len(cell.bodies)} bodies; expected at most {m.MAX_BODIES}: use simpler shapes"
        raise cell.config.error(("robots",), text)


def _robot(robot: Robot) -> m.RobotDescription:
    base = robot.model.base
    return m.RobotDescription(
        name=robot.name,
        urdf=asset_reference(robot.urdf, "application/xml"),
        joints=tuple(_joint(robot, index) for index in range(robot.model.n)),
        base_xyz=_point(base.t.tolist()),
        base_xyzw=base.xyzw(),
        period=robot.period,
        start=tuple(robot.start.tolist()),
        frames=tuple(robot.model.frame_names),
        tool=robot.tool,
        camera=robot.camera,
    )


def _joint(robot: Robot, index: int) -> m.Joint:
    joint = robot.model.joints[index]
    deceleration = float(robot.deceleration[index])
    return m.Joint(
        name=joint.name,
        kind=joint.kind,
        unit="rad" if joint.kind == "revolute" else "m",
        lower=float(robot.lower[index]),
        upper=float(robot.upper[index]),
        velocity=float(robot.velocity[index]),
        acceleration=float(robot.acceleration[index]),
        deceleration=deceleration if math.isfinite(deceleration) else None,
    )


def _body(cell: Cell, body: Body, meshes: Mapping[Convex, str]) -> m.Body:
    if body.robot is None:
        return _wire_body((body.name, None, None), body.shape, body.placement, meshes)
    robot = cell.robots[body.robot]
    own = robot.model.bodies[body.index]
    # The frame is that of the link in the URDF; the result does not depend on the joint positions.
    R, t = robot.model.body_placements(robot.start)
    link = robot.model.frame(robot.start, own.link)
    in_link = link.inverse() @ Placement(R[body.index], t[body.index])
    return _wire_body((body.name, robot.name, own.link), body.shape, in_link, meshes)


def _wire_body(
    names: tuple[str, str | None, str | None], shape: Shape, place: Placement, meshes: Mapping[Convex, str]
) -> m.Body:
    name, robot, link = names
    return m.Body(
        name=name,
        robot=robot,
        link=link,
        shape=_containing(shape),
        xyz=_point(place.t.tolist()),
        xyzw=place.xyzw(),
        exact=_exact(shape, meshes),
    )


def _containing(shape: Shape) -> m.Shape:
    """Return a primitive that contains a shape, in the same frame.

    It is the shape itself, except for a cone (its cylinder) and a convex body (its box): clients without the
    capability ``body.exact`` do not support these.
    """
    match shape:
        case Cone(radius=radius, length=length):
            return _containing(Cylinder(radius, length))
        case Convex():
            x, y, z = (2.0 * half for half in shape.half_sides)
            return _containing(Box(x, y, z))
        case _:
            return m.Shape(kind=shape.kind, size=shape.size)


def _exact(shape: Shape, meshes: Mapping[Convex, str]) -> m.Exact | None:
    match shape:
        case Cone():
            return m.Exact(kind=shape.kind, size=shape.size)
        case Convex(radius=radius):
            return m.Exact(kind=shape.kind, mesh=asset_reference(meshes[shape], "model/obj"), radius=radius)
        case _:
            return None


def _point(values: Sequence[float]) -> m.Point:
    x, y, z = values
    return (x, y, z)
