"""The configuration of a cell: strict models, read from overlaid YAML files.

Lengths and angles are numbers in m and rad or texts with a unit (``50 mm``, ``-94 deg``). Whether a joint's
values are angles or lengths is only known with its URDF, so they stay ``Quantity`` here and are checked in
``build_cell``. Unknown keys are refused. Needs no robot model: a machine without pinocchio can read them.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal, Self

import yaml
from pydantic import AfterValidator, BeforeValidator, Field, PrivateAttr, ValidationError, model_validator

from armgate.cell.errors import ConfigError
from armgate.cell.explain import explained
from armgate.cell.link_config import EmulatedLinkConfig, LinkConfig
from armgate.cell.operation_config import MetricsConfig, RecordingConfig
from armgate.cell.placement import Placement
from armgate.cell.shapes import Kind, Shape, shape_from
from armgate.cell.source import Node, Path_, finding, read_tree
from armgate.cell.values import (
    Acceleration,
    Account,
    Angle,
    Duration,
    Factor,
    JointValue,
    Length,
    Name,
    Part,
    Period,
    Size,
    SparsePart,
    Speed,
)

VERSION = 1
MAX_ROBOTS = 32
MAX_SURROUNDINGS = 1024


def _version(version: int) -> int:
    if version != VERSION:
        raise ValueError(f"version {version} of the configuration is not known; expected {VERSION}")
    return version


class Pose(Part):
    """A place: origin [m] and URDF's roll, pitch, yaw [rad]."""

    xyz: tuple[Length, Length, Length] = (0.0, 0.0, 0.0)
    rpy: tuple[Angle, Angle, Angle] = (0.0, 0.0, 0.0)

    @property
    def placement(self) -> Placement:
        """The same as a placement."""
        return Placement.from_rpy(self.xyz, self.rpy)


def _scale(given: object) -> object:
    """One factor counts for all axes."""
    return (given,) * 3 if isinstance(given, float | int) and not isinstance(given, bool) else given


class MeshOptions(Part):
    """How a mesh becomes convex bodies that together contain it and all that it encloses.

    Attributes:
        method: ``parts``: cut where that follows its form; ``hull``: its convex hull.
        threshold: How much larger than the mesh the parts may be together, as a share of its volume; they are
            cut until then.
        max_parts: At most so many parts.
        max_vertices: At most so many corners a part; what that loses, the part is thickened by.
    """

    method: Literal["parts", "hull"] = "parts"
    threshold: Annotated[float, Field(ge=0.01, le=10.0)] = 0.1
    max_parts: Annotated[int, Field(ge=1, le=256)] = 16
    max_vertices: Annotated[int, Field(ge=32, le=255)] = 96


class MeshConfig(MeshOptions):
    """A mesh.

    Attributes:
        file: Relative to the file in which it stands, ``file://…`` or ``package://…``.
        scale: What its coordinates are multiplied with to be in m.
    """

    file: str
    scale: Annotated[tuple[Factor, Factor, Factor], BeforeValidator(_scale)] = (1.0, 1.0, 1.0)


class MeshesConfig(MeshOptions):
    """How the meshes in a robot's URDF become convex bodies, and where its packages are.

    Attributes:
        packages: Folders for ``package://NAME/…``, relative to the file in which they stand.
        bodies: Other options for some links or bodies of the URDF.
    """

    packages: dict[Name, str] = {}
    bodies: dict[Name, MeshOptions] = {}


class ShapeConfig(SparsePart):
    """Exactly one shape: a mesh, or sizes [m] as in ``{box: [x, y, z]}``, ``{capsule: [radius, length]}``."""

    sphere: Size | None = None
    capsule: tuple[Size, Size] | None = None
    cylinder: tuple[Size, Size] | None = None
    box: tuple[Size, Size, Size] | None = None
    cone: tuple[Size, Size] | None = None
    mesh: MeshConfig | None = None

    @model_validator(mode="after")
    def _one(self) -> Self:
        count = len(self._given()) + (self.mesh is not None)
        if count != 1:
            known = ", ".join(type(self).model_fields)
            raise ValueError(f"{count} shapes; expected exactly one of {known}")
        return self

    def _given(self) -> dict[Kind, tuple[float, ...]]:
        sphere = None if self.sphere is None else (self.sphere,)
        sizes: dict[Kind, tuple[float, ...] | None] = {
            "sphere": sphere,
            "capsule": self.capsule,
            "cylinder": self.cylinder,
            "box": self.box,
            "cone": self.cone,
        }
        return {kind: size for kind, size in sizes.items() if size is not None}

    @property
    def shape(self) -> Shape:
        """The primitive.

        Raises:
            ValueError: It is a mesh.
        """
        ((kind, size),) = self._given().items()
        return shape_from(kind, size)


class SurroundingConfig(Pose):
    """A body that stands still in the world."""

    shape: ShapeConfig


class FrameConfig(Pose):
    """An extra frame, fixed in the frame of the link ``parent``."""

    parent: Name


class BodyConfig(Pose):
    """An extra body, fixed in the frame of the link ``link``."""

    link: Name
    shape: ShapeConfig


Range = tuple[Length, Length]


class TravelConfig(Part):
    """From where to where the carriage may go along each axis of the gantry's frame, m."""

    x: Range
    y: Range
    z: Range

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        for axis, (lower, upper) in (("x", self.x), ("y", self.y), ("z", self.z)):
            if lower >= upper:
                raise ValueError(f"{axis} goes from {lower:g} to {upper:g}; expected the lower end first")
        return self


class GantryConfig(Part):
    """A three-axis gantry whose joints X, Y, Z are the carriage's place in the gantry's frame, m.

    Attributes:
        travel: The joint limits.
        speed: Of each axis, m/s.
        acceleration: And deceleration, m/s²; None: the default of every joint.
        height: Underside of rails and bridge, m.
        span: Between the centre lines of both rails, m.
        beam: Edge of the square section of rails, posts and bridge, m.
        column: Edge of the square section of the vertical column, m.
        mount: The arm's root link in the frame of the carriage, which is the lower end of the column.
    """

    travel: TravelConfig
    speed: Speed = 1.0
    acceleration: Acceleration | None = None
    height: Size = 3.5
    span: Size = 4.6
    beam: Size = 0.3
    column: Size = 0.2
    mount: Pose = Pose()

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if self.travel.z[1] >= self.height:
            raise ValueError(
                f"the carriage's travel ends at {self.travel.z[1]:g} m, in the bridge; "
                f"expected travel.z below height ({self.height:g} m)"
            )
        inside = self.span / 2 - self.beam - self.column / 2
        if max(-self.travel.y[0], self.travel.y[1]) >= inside:
            raise ValueError(
                f"the carriage's travel {self.travel.y} runs into a rail; "
                f"expected travel.y within ±{inside:g} m or a larger span"
            )
        return self


class JointConfig(SparsePart):
    """Own bounds of one joint, tighter than the URDF's; what is left out is taken from there.

    ``acceleration`` and ``deceleration`` default to velocity / 0.25 s; ``deceleration: null`` means no bound.
    """

    lower: JointValue | None = None
    upper: JointValue | None = None
    velocity: JointValue | None = None
    acceleration: JointValue | None = None
    deceleration: JointValue | None = None


class RobotConfig(Part):
    """One robot of the cell; see ``configs/demo.yaml``."""

    urdf: str
    base: Pose = Pose()
    gantry: GantryConfig | None = None
    frames: dict[Name, FrameConfig] = {}
    bodies: dict[Name, BodyConfig] = {}
    tool: Name = "tool0"
    camera: Name | None = None
    start: tuple[JointValue, ...]
    period: Annotated[Period, Field(ge=1e-4, le=10.0)] = 0.012
    joints: dict[Name, JointConfig] = {}
    meshes: MeshesConfig = MeshesConfig()
    ignore_pairs: tuple[tuple[Name, Name], ...] = ()
    lag_window: Annotated[Duration, Field(ge=0.0)] = 0.0
    lag_difference: Annotated[Duration, Field(ge=0.0)] | None = None
    q_tolerance: Annotated[float, Field(ge=0.0, le=1.0)] = 1e-6
    link: Annotated[LinkConfig, Field(discriminator="kind")] = EmulatedLinkConfig()


class WallClockConfig(Part):
    """Robots tick by the clock on the wall."""

    kind: Literal["wall"] = "wall"


class LockstepClockConfig(Part):
    """Time passes when every participant has commanded or passed; a silent one is dropped after ``grace``."""

    kind: Literal["lockstep"]
    participants: Annotated[tuple[Name, ...], Field(min_length=1)]
    grace: Period = 10.0

    @model_validator(mode="after")
    def _once(self) -> Self:
        if len(set(self.participants)) != len(self.participants):
            raise ValueError("a participant is named twice; expected every name once")
        return self


class TlsConfig(Part):
    """Files in PEM; relative paths count from the file in which they stand.

    Attributes:
        certificate: The server's certificate, then those between it and its CA.
        key: Its private key, not encrypted and not readable by everybody.
        client_ca: Where given, a client must show a certificate that one of these CAs has signed.
    """

    certificate: str
    key: str
    client_ca: str | None = None


class SocketConfig(Part):
    """A Unix socket for clients of this machine, which the kernel identifies.

    Attributes:
        path: Where it is; relative to the file in which it stands.
        users: The most that each user may, by name or number; others are refused, unless they have a token.
    """

    path: str
    users: Annotated[
        dict[str, Literal["observer", "controller", "operator"]], Field(min_length=1, max_length=256)
    ]


class SignalRuleConfig(Part):
    """Clients that may set the signals under a prefix.

    Attributes:
        role: The least role.
        clients: Names of tokens, or ``uid N`` for users on the Unix socket; names of clients if the server
            has neither tokens nor a socket. None: all.
    """

    role: Literal["controller", "operator"] = "controller"
    clients: Annotated[tuple[Account, ...], Field(min_length=1)] | None = None


class ServerConfig(Part):
    """Where and how the daemon serves; port 0 takes any free one.

    Attributes:
        host: Address to listen on; beyond loopback only with ``tls`` and ``tokens``.
        port: Port to listen on.
        tls: Certificate and key; None: no encryption.
        tokens: File of those who may come in, see ``armgate token``; None: roles are self-declared.
        socket: A Unix socket to listen on too; without ``tokens`` the daemon listens on nothing else.
        lease_ttl: How long a lease lives without a sign of life from its holder, s.
        max_connections: How many connections there may be at once.
        max_connections_per_address: How many of them from one address.
        connection_rate: How many connections are taken in per second on average; others wait.
        signal_rate: How many signals a client may send per second on average.
        signals_per_client: How many signals a client (all clients with one token) may have.
        signals: Who may set the signals whose names begin with a prefix; ``operator.`` is for operators
            unless it is named here.
        message_rate: How many messages of a client are read per second on average; others wait. Not in
            lock-step.
        message_rate_per_identity: The same for all clients with one token (without tokens: at one address).
            Holders of robots, and operators with a token, do not count here and in the next two.
        message_rate_per_address: The same for all clients at one address.
        message_rate_in_all: The same for all clients.
        login_failures: How many wrong tokens per minute on average are logged one by one.
        login_failures_per_address: The same for one address.
        handshake_timeout: How long a new connection may take for TLS, and then to say hello, s.
        send_buffer: Bytes of answers and verdicts that may wait for a slow client before it is closed.
        robot_server: Socket of the robot server that holds the robots, relative to the file in which it
            stands; None: the default one if a robot is not emulated, else the daemon holds them.
    """

    host: str = "127.0.0.1"
    port: Annotated[int, Field(ge=0, le=65535)] = 7411
    tls: TlsConfig | None = None
    tokens: str | None = None
    socket: SocketConfig | None = None
    lease_ttl: Period = 1.0
    max_connections: Annotated[int, Field(ge=1, le=4096)] = 128
    max_connections_per_address: Annotated[int, Field(ge=1, le=4096)] = 64
    connection_rate: Annotated[float, Field(gt=0.0)] = 100.0
    signal_rate: Annotated[float, Field(gt=0.0)] = 1000.0
    signals_per_client: Annotated[int, Field(ge=1, le=64)] = 32
    signals: Annotated[dict[Name, SignalRuleConfig], Field(max_length=64)] = {}
    message_rate: Annotated[float, Field(gt=0.0)] = 2000.0
    message_rate_per_identity: Annotated[float, Field(gt=0.0)] = 3000.0
    message_rate_per_address: Annotated[float, Field(gt=0.0)] = 4000.0
    message_rate_in_all: Annotated[float, Field(gt=0.0)] = 6000.0
    login_failures: Annotated[float, Field(ge=1.0)] = 100.0
    login_failures_per_address: Annotated[float, Field(ge=1.0)] = 10.0
    handshake_timeout: Period = 5.0
    send_buffer: Annotated[int, Field(ge=1 << 20)] = 1 << 22
    robot_server: str | None = None


class CellConfig(Part):
    """The whole cell."""

    armgate: Annotated[int, AfterValidator(_version)]
    name: Name
    stop_distance: Size = 0.05
    self_distance: Size = 0.02
    response: Literal["stop", "slow"] = "stop"
    max_age_ticks: Annotated[int, Field(ge=1, le=1000)] = 3
    robots: Annotated[dict[Name, RobotConfig], Field(min_length=1, max_length=MAX_ROBOTS)]
    surroundings: Annotated[dict[Name, SurroundingConfig], Field(max_length=MAX_SURROUNDINGS)] = {}
    clock: Annotated[WallClockConfig | LockstepClockConfig, Field(discriminator="kind")] = WallClockConfig()
    server: ServerConfig = ServerConfig()
    recording: RecordingConfig = RecordingConfig()
    metrics: MetricsConfig = MetricsConfig()

    _tree: Node | None = PrivateAttr(default=None)

    def error(self, path: Path_, text: str) -> ConfigError:
        """A ``ConfigError`` about the value under these keys, with its file and line where they are known."""
        return finding(None if self._tree is None else self._tree.locate(path), path, text)

    def urdf_path(self, robot: str) -> Path:
        """The file that holds a robot's URDF: relative paths count from the file in which they stand."""
        return self.file(("robots", robot, "urdf"), self.robots[robot].urdf)

    def file(self, path: Path_, given: str) -> Path:
        """The file that stands under these keys: relative paths count from the file in which they stand."""
        if self._tree is None:
            return Path(given)
        return self._tree.locate(path).file.parent / given


def load_config(paths: Sequence[Path]) -> CellConfig:
    """Reads a configuration; later files overlay earlier ones.

    Raises:
        ConfigError: A file cannot be read, is malformed, or a value is not what was expected; the text names
            file, line, key and expectation of every finding.
    """
    tree = read_tree(paths)
    try:
        config = CellConfig.model_validate(tree.plain())
    except ValidationError as error:
        raise explained(error, tree, CellConfig) from error
    config._tree = tree
    return config


def dump_config(config: CellConfig) -> str:
    """The configuration as one YAML file, defaults spelt out; paths stay as they were given."""
    return yaml.safe_dump(config.model_dump(mode="json"), sort_keys=False, allow_unicode=True)
