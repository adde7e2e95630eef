"""Scene model: meshes on the links of robots and in the world, and the poses of links at q."""

from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armgate.apps.errors import AppError
from armgate.apps.view import colours
from armgate.apps.view.real_meshes import bodies_of, real_meshes
from armgate.apps.view.shapes import Mesh, convex, cylinder, joined, mesh_of
from armgate.cell.model import RobotModel
from armgate.cell.placement import Placement
from armgate.client import Body, Description, RobotDescription

Array = NDArray[np.float64]
Asset = Callable[[str], bytes]

TOOL_RADIUS = 0.03
"""Radius of the marker at the tool of a robot without a camera, m."""


@dataclass(frozen=True, eq=False)
class Piece:
    """Meshes of one colour that move together.

    Attributes:
        colour: Red, green, blue, 0 to 255.
        mesh: Mesh in the frame of the link, or in the world.
    """

    colour: colours.RGB
    mesh: Mesh


@dataclass(frozen=True, eq=False)
class SceneRobot:
    """Robot of a scene.

    Attributes:
        name: Name of the robot.
        described: Description from the daemon.
        urdf: URDF of the robot.
        pieces: Meshes by link.
    """

    name: str
    described: RobotDescription
    urdf: str
    pieces: Mapping[str, tuple[Piece, ...]]

    def model(self) -> RobotModel:
        """Return a model of its kinematics; each thread needs its own."""
        base = Placement.from_quaternion(self.described.base_xyz, self.described.base_xyzw)
        return RobotModel.from_urdf(self.urdf, base)


@dataclass(frozen=True, eq=False)
class Scene:
    """Scene of a cell.

    Attributes:
        description: Description from the daemon.
        robots: Robots in the order of the description.
        surroundings: Meshes of the surroundings, in the world.
    """

    description: Description
    robots: tuple[SceneRobot, ...]
    surroundings: tuple[Piece, ...]

    @classmethod
    def build(cls, description: Description, asset: Asset, *, meshes: bool = True) -> "Scene":
        """Build the scene from a description and its assets, with real meshes of known arms if installed.

        Raises:
            AppError: An asset is not text, or is not a convex mesh as written by daemons.
            ModelError: A URDF cannot be read.
        """
        bodies = defaultdict(list)
        for body in description.bodies:
            bodies[body.robot].append(body)
        robots = tuple(_robot(robot, bodies[robot.name], asset, meshes) for robot in description.robots)
        standing = [(colours.surrounding(body.name), _mesh(body, asset)) for body in bodies[None]]
        return cls(description, robots, _pieces(standing))

    @property
    def camera_robot(self) -> SceneRobot | None:
        """The first robot with a camera."""
        return next((robot for robot in self.robots if robot.described.camera), None)


class Poses:
    """Poses of the links of all robots; to be used by one thread."""

    def __init__(self, scene: Scene) -> None:
        self._links = {robot.name: tuple(robot.pieces) for robot in scene.robots}
        self.models = {robot.name: robot.model() for robot in scene.robots}

    def links(self, robot: str, q: ArrayLike) -> dict[str, Placement]:
        """Return the poses of the links that carry meshes, in the world."""
        model = self.models[robot]
        return {link: model.frame(q, link) for link in self._links[robot]}


def _robot(robot: RobotDescription, bodies: list[Body], asset: Asset, real_ones: bool) -> SceneRobot:
    urdf = _text(asset, robot.urdf.hash)
    base = Placement.from_quaternion(robot.base_xyz, robot.base_xyzw)
    model = RobotModel.from_urdf(urdf, base)
    meshes: dict[str, list[tuple[colours.RGB, Mesh]]] = defaultdict(list)
    real = real_meshes(urdf) if real_ones else {}
    replaced = {body for body in bodies_of(urdf) if body[0] in real}
    for body in bodies:
        if body.link is not None and (body.link, body.name.rpartition("/")[2]) not in replaced:
            meshes[body.link].append((_robot_colour(model, body), _mesh(body, asset)))
    for link, found in real.items():
        meshes[link] += [(colour or _link_colour(model, link), mesh) for colour, mesh in found]
    if not real:
        for link, cap in (*_joint_caps(model, bodies), *_bones(model, bodies)):
            meshes[link].append((colours.DARK, cap))
    if robot.camera is None:
        meshes[robot.tool].append((colours.TOOL, mesh_of("sphere", (TOOL_RADIUS,))))
    else:
        meshes[robot.camera].append((colours.DARK, _lens()))
    return SceneRobot(robot.name, robot, urdf, {link: _pieces(found) for link, found in meshes.items()})


def _pieces(found: list[tuple[colours.RGB, Mesh]]) -> tuple[Piece, ...]:
    by_colour = defaultdict(list)
    for colour, mesh in found:
        by_colour[colour].append(mesh)
    return tuple(Piece(colour, joined(meshes)) for colour, meshes in by_colour.items())


def _mesh(body: Body, asset: Asset) -> Mesh:
    place = Placement.from_quaternion(body.xyz, body.xyzw)
    exact = body.exact
    if exact is not None and exact.mesh is not None:
        return _hull(_text(asset, exact.mesh.hash), exact.mesh.hash).at(place)
    if exact is not None and exact.kind == "cone":
        return mesh_of("cone", exact.size).at(place)
    return mesh_of(body.shape.kind, body.shape.size).at(place)


def _text(asset: Asset, name: str) -> str:
    try:
        return asset(name).decode()
    except UnicodeDecodeError as error:
        raise AppError(f"the description's asset {name[:12]}… is not text in UTF-8") from error


def _hull(obj: str, name: str) -> Mesh:
    """Return the convex body of an OBJ file as written by the daemon."""
    rows = [line.split() for line in obj.splitlines()]
    try:
        vertices = [(float(x), float(y), float(z)) for key, x, y, z in rows if key == "v"]
        faces = [(int(a) - 1, int(b) - 1, int(c) - 1) for key, a, b, c in rows if key == "f"]
        return convex(np.array(vertices), np.array(faces))
    except (ValueError, IndexError, OverflowError) as error:
        text = f"the description's asset {name[:12]}… is not a convex mesh"
        raise AppError(f"{text}; expected triangles in OBJ, as written by daemons") from error


# --- an arm of primitives ----------------------------------------------------------------------------------


def _link_colour(model: RobotModel, link: str) -> colours.RGB:
    """Return the colour of a link: orange for the arm, dark for the links that carry it and for its hand."""
    joint = model.frame_joint(link)
    turning = 0
    while joint >= 0:
        turning += model.joints[joint].kind == "revolute"
        joint = model.parents[joint]
    every = sum(joint.kind == "revolute" for joint in model.joints)
    if turning == 0:
        return colours.STRUCTURE
    return colours.HAND if turning >= max(every - 1, 2) else colours.ARM


def _robot_colour(model: RobotModel, body: Body) -> colours.RGB:
    assert body.link is not None
    return colours.DARK if "camera" in body.name else _link_colour(model, body.link)


def _joint_caps(model: RobotModel, bodies: list[Body]) -> list[tuple[str, Mesh]]:
    """Return dark discs on both sides of the arm at its joints, which look like joint covers."""
    caps = []
    for body in bodies:
        joint = -1 if body.link is None else model.frame_joint(body.link)
        if joint < 0 or body.shape.kind != "capsule" or body.link is None:
            continue
        place = Placement.from_quaternion(body.xyz, body.xyzw)
        axis, along = _axis(model, joint), place.R[:, 2]
        radius, length = body.shape.size
        past = float(np.linalg.norm(place.t)) - length / 2 - radius
        if axis is not None and abs(axis @ along) < 0.5 and past < 0.0:
            caps.append((body.link, cylinder(0.62 * radius, 2.12 * radius).at(_towards(axis))))
    return caps


def _bones(model: RobotModel, bodies: list[Body]) -> list[tuple[str, Mesh]]:
    """Return thin rods between the joint axes, visible where the bodies leave gaps."""
    round_ = [body.shape.size[0] for body in bodies if body.shape.kind in ("capsule", "cylinder")]
    q, rods = np.zeros(model.n), []
    for joint, parent in enumerate(model.parents):
        if parent < 0 or model.joints[parent].kind != "revolute":
            continue
        links = [_first_link(model, parent), _first_link(model, joint)]
        here, there = (model.frame(q, link) for link in links)
        end = here.inverse().apply(there.t)
        length = float(np.linalg.norm(end))
        if round_ and length > 8.0 * min(round_):
            middle = Placement(_towards(end / length).R, end / 2)
            rods.append((links[0], cylinder(0.9 * min(round_), length).at(middle)))
    return rods


def _axis(model: RobotModel, joint: int) -> Array | None:
    """Return the axis of a joint in the frame of its link; None if the joint is not revolute."""
    if model.joints[joint].kind != "revolute":
        return None
    link, q = _first_link(model, joint), np.zeros(model.n)
    J = model.frame_jacobian(q, link)
    return model.frame(q, link).R.T @ J[3:, joint]


def _first_link(model: RobotModel, joint: int) -> str:
    return next(name for name in model.frame_names if model.frame_joint(name) == joint)


def _towards(axis: Array) -> Placement:
    """Return a frame at the origin whose z axis is this axis."""
    side = np.eye(3)[int(np.argmin(np.abs(axis)))]
    x = np.cross(side, axis)
    x /= np.linalg.norm(x)
    return Placement(np.stack([x, np.cross(axis, x), axis], axis=1), np.zeros(3))


def _lens() -> Mesh:
    return cylinder(0.03, 0.04).at(Placement(np.eye(3), np.array([0.0, 0.0, 0.1])))
