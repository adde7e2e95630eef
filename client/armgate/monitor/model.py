"""Cell model of the monitor: joints and bounds, bodies, and the pairs that must keep a distance."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, Literal, assert_never

import numpy as np
from numpy.typing import NDArray

from armgate.monitor.config_section import Section, si
from armgate.monitor.configured_shapes import MESH_KEYS, configured, locate, mesh_solids, method_of
from armgate.monitor.convex_solid import Solid
from armgate.monitor.errors import DescriptionError
from armgate.monitor.files import Located
from armgate.monitor.gantry import AXES, add_gantry
from armgate.monitor.mesh_solids import boxed
from armgate.monitor.transforms import Array
from armgate.monitor.urdf_file import Body as UrdfBody
from armgate.monitor.urdf_file import Description, Joint, MeshUse, read_urdf

Kind = Literal["self", "robots", "surroundings"]
KINDS: tuple[Kind, ...] = ("robots", "surroundings", "self")

RAMP = 0.25
"""Time to full speed that defines the default acceleration and deceleration of a joint, s."""

_ROBOT_KEYS = (
    "urdf", "base", "gantry", "frames", "bodies", "tool", "camera", "start", "period", "joints", "meshes",
    "ignore_pairs", "lag_window", "lag_difference", "q_tolerance", "link",
)  # fmt: skip
_CELL_KEYS = (
    "armgate", "name", "stop_distance", "self_distance", "response", "max_age_ticks", "robots",
    "surroundings", "clock", "server", "recording", "metrics",
)  # fmt: skip
MAX_PAIRS = 200_000


@dataclass(frozen=True, eq=False)
class CellBody:
    """Body; ``placement`` is in the frame of its joint, or in the world if no joint moves it.

    Attributes:
        name: Name such as ``FR/link_3``, or that of a body of the surroundings.
        robot: Index of its robot; None for the surroundings.
        link: Its link; "" for the surroundings.
        joint: Index of the joint that carries it; −1 if nothing moves it.
        placement: (4, 4).
        local: Its placement in the frame of its link, (4, 4).
        solid: Its shape.
        meshed: True for a piece of a mesh.
    """

    name: str
    robot: int | None
    link: str
    joint: int
    placement: Array
    local: Array
    solid: Solid
    meshed: bool = False


@dataclass(frozen=True)
class Pair:
    """Two bodies, by index, and their required distance ``limit`` [m].

    For two bodies of one robot, ``a`` is the one whose joint has the lower index.
    """

    a: int
    b: int
    limit: float
    kind: Kind


@dataclass(frozen=True, eq=False)
class Robot:
    """Robot; arrays have one row per joint, in the order of the states.

    Attributes:
        name: Its name.
        joints: Names of the joints.
        revolute: True for revolute joints, False for prismatic ones, (n,).
        parents: Index of the joint that carries each joint, −1 for the base.
        origins: Placement of each joint in its parent's frame, or in the world if its parent is the base, (n,
            4, 4).
        axes: (n, 3), unit length.
        lower, upper: Limits, rad or m, (n,).
        velocity, acceleration, deceleration: Bounds per s and s², (n,); inf: unbounded.
        period: Period of its clock, s.
        lag_window: Time in which older setpoints may still act, s.
        q_tolerance: Error of a measured position, rad or m.
        base: Placement of its root link in the world, (4, 4).
        chain: All joints of URDF, gantry and frames, including fixed ones.
        holds: True if its link holds the robot at once, without braking, when a reply is late.
    """

    name: str
    joints: tuple[str, ...]
    revolute: NDArray[np.bool_]
    parents: tuple[int, ...]
    origins: Array
    axes: Array
    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array
    deceleration: Array
    period: float
    lag_window: float
    q_tolerance: float
    base: Array
    chain: tuple[Joint, ...]
    holds: bool

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)


@dataclass(frozen=True, eq=False)
class Cell:
    """Cell with all robots, bodies and pairs.

    Attributes:
        robots: In the order of the configuration.
        bodies: Those of all robots, then the surroundings.
        pairs: Pairs of bodies that must keep a distance.
        stop_distance, self_distance: Required distances, m.
        notes: Keys of the configuration that the monitor ignores, as texts.
    """

    robots: tuple[Robot, ...]
    bodies: tuple[CellBody, ...]
    pairs: tuple[Pair, ...]
    stop_distance: float
    self_distance: float
    notes: tuple[str, ...] = ()


Orders = Mapping[str, Sequence[str]]
"""Names of each robot's joints in the order of the states."""


def build(tree: Mapping[str, Any], orders: Orders | None = None) -> Cell:
    """Build the cell from a configuration.

    Args:
        tree: Result of ``read_files``.
        orders: Joint orders that the daemon describes; None: those of the URDFs.

    Raises:
        DescriptionError: Something cannot be read; the text names the place.
    """
    top = Section(dict(tree), "")
    if top.values.get("armgate") != 1:
        raise DescriptionError(f"armgate: the monitor does not support version {top.values.get('armgate')!r}")
    notes = [f"{key}: unknown key, ignored" for key in top.values if key not in _CELL_KEYS]
    made = []
    for index, (name, own) in enumerate(top.sections("robots")):
        notes += [f"{own.place(key)}: unknown key, ignored" for key in own.values if key not in _ROBOT_KEYS]
        made.append(_Builder(index, name, own, (orders or {}).get(name)).built())
    if not made:
        raise DescriptionError("robots: expected at least one robot")
    robots = tuple(robot for robot, _ in made)
    bodies = [body for _, own_bodies in made for body in own_bodies]
    for name, surrounding in top.sections("surroundings"):
        bodies += _surroundings(name, surrounding)
    stop, own_stop = top.number("stop_distance", 0.05, "length"), top.number("self_distance", 0.02, "length")
    ignored = _ignored(top, bodies)
    pairs = tuple(_pairs(robots, bodies, ignored, (stop, own_stop)))
    return Cell(robots, tuple(bodies), pairs, stop, own_stop, tuple(notes))


def _surroundings(name: str, own: Section) -> list[CellBody]:
    own.only("shape", "xyz", "rpy")
    solids = configured(own.section("shape"), {})
    meshed = "mesh" in own.section("shape").values
    place = own.pose()
    return [CellBody(name, None, "", -1, place, place, solid, meshed) for solid in solids]


@dataclass(frozen=True, eq=False)
class _Mount:
    """Mount of a link: its joint (−1: base), and its placement in the frame of that joint."""

    joint: int
    placement: Array


class _Builder:
    """Builder of one robot: arm, gantry, frames and bodies."""

    def __init__(self, index: int, name: str, own: Section, order: Sequence[str] | None) -> None:
        self._index, self._name, self._own, self._order = index, name, own, order
        packages = own.section("meshes").section("packages").values
        self._packages = {key: value.path for key, value in packages.items() if isinstance(value, Located)}

    def built(self) -> tuple[Robot, list[CellBody]]:
        """Return the robot and its bodies."""
        urdf = self._own.values.get("urdf")
        if not isinstance(urdf, Located):
            raise DescriptionError(f"{self._own.place('urdf')}: expected a file")
        found = read_urdf(urdf.path)
        if self._own.values.get("gantry") is not None:
            found = add_gantry(found, self._own.section("gantry"))
        for name, frame in self._own.sections("frames"):
            frame.only("parent", "xyz", "rpy")
            mount = Joint(f"{name}_mount", "fixed", frame.text("parent", ""), name, frame.pose(), np.zeros(3))
            found.joints.append(mount)
        base = self._own.section("base").pose()
        moving, mounts = self._tree(found, base)
        bodies = [b for body in found.bodies for b in self._of_urdf(body, mounts, urdf)]
        for name, body in self._own.sections("bodies"):
            bodies += self._of_config(name, body, mounts)
        return self._robot(found, moving, base), bodies

    def _tree(self, found: Description, base: Array) -> tuple[list[Joint], dict[str, _Mount]]:
        """Return the moving joints in the order of the states, and the mount of each link."""
        moving: list[Joint] = []
        front = [found.root]
        while front:
            here = [joint for joint in found.joints if joint.parent == front[0]]
            moving += [joint for joint in here if joint.kind != "fixed"]
            front = [joint.child for joint in here] + front[1:]
        if self._order is not None:
            by_name = {joint.name: joint for joint in moving}
            if sorted(self._order) != sorted(by_name):
                raise DescriptionError(
                    f"robot {self._name} has the joints {', '.join(by_name)}; "
                    f"the daemon describes {', '.join(self._order)}"
                )
            moving = [by_name[name] for name in self._order]
        return moving, self._mounts(found, [joint.name for joint in moving], base)

    def _mounts(self, found: Description, names: list[str], base: Array) -> dict[str, _Mount]:
        mounts, front = {found.root: _Mount(-1, base)}, [found.root]
        self._parents = dict.fromkeys(names, -1)
        self._origins: dict[str, Array] = {}
        while front:
            link = front.pop()
            at = mounts[link]
            for joint in (joint for joint in found.joints if joint.parent == link):
                place = at.placement @ joint.origin
                if joint.kind == "fixed":
                    mounts[joint.child] = _Mount(at.joint, place)
                else:
                    self._parents[joint.name], self._origins[joint.name] = at.joint, place
                    mounts[joint.child] = _Mount(names.index(joint.name), np.eye(4))
                front.append(joint.child)
        return mounts

    def _mount(self, mounts: dict[str, _Mount], link: str, where: str) -> _Mount:
        if link not in mounts:
            raise DescriptionError(f"{where}: there is no link {link!r}")
        return mounts[link]

    def _of_urdf(self, body: UrdfBody, mounts: dict[str, _Mount], urdf: Located) -> list[CellBody]:
        at = mounts[body.link]
        match body.shape:
            case Solid():
                solids, meshed = [body.shape], False
            case MeshUse(uri=uri, scale=scale):
                file = locate(urdf.beside(uri), self._packages)
                solids, meshed = mesh_solids(file, scale, self._method(body)), True
            case _:
                assert_never(body.shape)
        place = at.placement @ body.origin
        name = f"{self._name}/{body.name.partition('/')[0]}"
        return [
            CellBody(name, self._index, body.link, at.joint, place, body.origin, boxed(solid), meshed)
            for solid in solids
        ]

    def _method(self, body: UrdfBody) -> str:
        """Return the method for a mesh of the URDF: that of its body, of its link, or of all meshes."""
        meshes = self._own.section("meshes")
        meshes.only(*MESH_KEYS, "packages", "bodies")
        own = dict(meshes.sections("bodies"))
        return method_of(own.get(body.name) or own.get(body.link) or meshes)

    def _of_config(self, name: str, body: Section, mounts: dict[str, _Mount]) -> list[CellBody]:
        body.only("link", "shape", "xyz", "rpy")
        link = body.text("link", "")
        at = self._mount(mounts, link, body.place("link"))
        meshed = "mesh" in body.section("shape").values
        whole, local = f"{self._name}/{name}", body.pose()
        return [
            CellBody(whole, self._index, link, at.joint, at.placement @ local, local, solid, meshed)
            for solid in configured(body.section("shape"), self._packages)
        ]

    def _robot(self, found: Description, moving: list[Joint], base: Array) -> Robot:
        rows = [self._bounds(joint) for joint in moving]
        lower, upper, velocity, acceleration, deceleration = np.array(rows).reshape(-1, 5).T.copy()
        names = tuple(joint.name for joint in moving)
        return Robot(
            self._name,
            names,
            np.array([joint.kind == "revolute" for joint in moving]),
            tuple(self._parents[name] for name in names),
            np.array([self._origins[name] for name in names]),
            np.array([joint.axis for joint in moving]),
            lower,
            upper,
            velocity,
            acceleration,
            deceleration,
            self._own.number("period", 0.012, "time"),
            self._own.number("lag_window", 0.0, "time"),
            self._own.number("q_tolerance", 1e-6, "angle"),
            base,
            tuple(found.joints),
            self._own.section("link").text("kind", "emulated") != "emulated",
        )

    def _bounds(self, joint: Joint) -> tuple[float, ...]:
        """Return lower, upper, velocity, acceleration and deceleration of a joint."""
        own = Section(self._own.section("joints").values.get(joint.name) or {}, f"joints.{joint.name}")
        own.only("lower", "upper", "velocity", "acceleration", "deceleration")
        dimension = "angle" if joint.kind == "revolute" else "length"

        def bound(key: str, default: float, rate: int) -> float:
            value = own.values.get(key)
            return default if value is None else si(value, own.place(key), dimension, rate)

        velocity = bound("velocity", joint.velocity, 1)
        ramp = velocity / RAMP
        gantry = self._own.values.get("gantry")
        if gantry is not None and joint.name in AXES:
            ramp = self._own.section("gantry").number("acceleration", ramp, "length", 2)
        unbounded = "deceleration" in own.values and own.values["deceleration"] is None
        deceleration = np.inf if unbounded else bound("deceleration", min(ramp, joint.deceleration), 2)
        return (
            bound("lower", joint.lower, 0),
            bound("upper", joint.upper, 0),
            velocity,
            bound("acceleration", min(ramp, joint.acceleration), 2),
            deceleration,
        )


# --- pairs ------------------------------------------------------------------------------------------------


def _ignored(top: Section, bodies: Sequence[CellBody]) -> set[frozenset[int]]:
    """Return the pairs of body indices that ``ignore_pairs`` lists."""
    ignored: set[frozenset[int]] = set()
    for index, (_, own) in enumerate(top.sections("robots")):
        for entry in own.values.get("ignore_pairs") or ():
            if not (isinstance(entry, list) and len(entry) == 2):
                raise DescriptionError(f"{own.place('ignore_pairs')}: expected pairs of names")
            first, second = (_named(bodies, index, name) for name in entry)
            second = second or [i for i, b in enumerate(bodies) if b.robot is None and b.name == entry[1]]
            if not first or not second:
                raise DescriptionError(
                    f"{own.place('ignore_pairs')}: there are no bodies with the names {entry}"
                )
            ignored.update(frozenset((a, b)) for a in first for b in second)
    return ignored


def _named(bodies: Sequence[CellBody], robot: int, name: object) -> list[int]:
    """Return the bodies of a robot with this name, or with a link of this name."""
    return [
        i
        for i, body in enumerate(bodies)
        if body.robot == robot and name in (body.link, body.name.partition("/")[2])
    ]


def _pairs(
    robots: Sequence[Robot],
    bodies: Sequence[CellBody],
    ignored: set[frozenset[int]],
    distances: tuple[float, float],
) -> list[Pair]:
    """Return the pairs with relative motion, except neighbours on one robot and ignored pairs."""
    pairs: list[Pair] = []
    for a, b in combinations(range(len(bodies)), 2):
        first, second = bodies[a], bodies[b]
        if (first.joint < 0 and second.joint < 0) or frozenset((a, b)) in ignored:
            continue
        if first.robot == second.robot and first.robot is not None:
            if not _neighbours(robots[first.robot], first.joint, second.joint):
                inner, outer = (a, b) if first.joint < second.joint else (b, a)
                pairs.append(Pair(inner, outer, distances[1], "self"))
        else:
            pairs.append(Pair(a, b, distances[0], "surroundings" if second.robot is None else "robots"))
        if len(pairs) > MAX_PAIRS:
            raise DescriptionError(
                f"more than {MAX_PAIRS} pairs of bodies, the largest number that the monitor checks"
            )
    return pairs


def _neighbours(robot: Robot, a: int, b: int) -> bool:
    """Return True if one joint carries both bodies, or the joint of one carries that of the other."""
    return a == b or (a >= 0 and robot.parents[a] == b) or (b >= 0 and robot.parents[b] == a)
