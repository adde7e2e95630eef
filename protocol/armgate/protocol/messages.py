"""Messages of protocol version 1: the single definition of their form.

A message is a msgpack map with a ``type`` and the fields of one model below. Models are strict: a text is
not a number and a bool is not a number, but an integer is accepted as a float. Unknown keys are ignored.
Every list, text and map is bounded. The tables of SPEC.md, the vectors and the JSON Schema are generated from
this module.

A new message needs three entries here: its model, its place in the union ``ClientMessage`` or
``ServerMessage``, and, for a request, its answer in ``ANSWERS``.

Units: rad and m for joints (by the joint's type), m for points, s for times. Points and placements of the
surroundings are in the world frame; a quaternion is x, y, z, w.
"""

from typing import Annotated, ClassVar, Literal, get_args

from pydantic import BaseModel, ConfigDict, Field, StringConstraints

MAX_JOINTS = 64
MAX_ROBOTS = 32
MAX_BODIES = 4096
MAX_FRAMES = 256
MAX_CHUNK = 256 * 1024
MAX_SIGNAL = 16
MAX_SIGNALS = 64
MAX_SESSIONS = 1024
MAX_TEXT = 512
MAX_REASONS = 64
MAX_NEAREST = 16
MAX_STOPS = 64
MAX_COUNTS = 64
MAX_WARNINGS = 16

Name = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_.:/-]{1,64}$")]
Text = Annotated[str, StringConstraints(max_length=MAX_TEXT)]
Token = Annotated[str, StringConstraints(min_length=1, max_length=256)]
Hash = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")]
Count = Annotated[int, Field(ge=0, lt=2**63)]
Id = Annotated[int, Field(ge=0, lt=2**31)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Share = Annotated[float, Field(gt=0.0, le=1.0, allow_inf_nan=False)]
Joints = Annotated[tuple[Finite, ...], Field(max_length=MAX_JOINTS)]
Increment = Annotated[tuple[float, ...], Field(max_length=MAX_JOINTS)]
"""A requested increment may contain NaN and infinities: such a command is readable, so it gets a verdict."""
Point = tuple[Finite, Finite, Finite]
Quaternion = tuple[Finite, Finite, Finite, Finite]
Versions = Annotated[tuple[Annotated[int, Field(ge=1, le=2**16)], ...], Field(min_length=1, max_length=16)]
Capabilities = Annotated[tuple[Name, ...], Field(max_length=64)]
Role = Literal["observer", "controller", "operator"]


class Message(BaseModel):
    """Base of all messages: strict, immutable, tolerant of keys that a later version adds."""

    model_config = ConfigDict(strict=True, frozen=True, extra="ignore")
    type: str


class Part(BaseModel):
    """Base of all maps inside messages."""

    model_config = ConfigDict(strict=True, frozen=True, extra="ignore")


# --- from the client --------------------------------------------------------------------------------------


class Request(Message):
    """Message that is answered; the answer's ``re`` repeats its ``id``."""

    id: Id | None = None


class Hello(Request):
    """First message of a connection: name, role and supported versions of the client."""

    type: Literal["hello"] = "hello"
    versions: Versions
    name: Name
    role: Role = "controller"
    token: Token | None = None
    capabilities: Capabilities = ()
    software: Text = ""


class Describe(Request):
    """Request for the description of the cell."""

    type: Literal["describe"] = "describe"


class Asset(Request):
    """Request for a piece of an asset, named by the hash in the description."""

    type: Literal["asset"] = "asset"
    hash: Hash
    offset: Count = 0
    length: Annotated[int, Field(ge=1, le=MAX_CHUNK)] = MAX_CHUNK


class Acquire(Request):
    """Request for the lease of a robot; ``speed`` is a tighter speed bound, a share of the cell's."""

    type: Literal["acquire"] = "acquire"
    robot: Name
    takeover: bool = False
    speed: Share = 1.0


class Release(Request):
    """Release of a lease."""

    type: Literal["release"] = "release"
    robot: Name
    fence: Count


class Command(Message):
    """Increment ``dq`` to the setpoint at the robot's next tick, based on the state at ``tick``."""

    type: Literal["command"] = "command"
    robot: Name
    fence: Count
    seq: Count
    tick: Count
    dq: Increment
    deadline: Finite | None = None
    horizon: Count | None = None


class Pass(Message):
    """Lock-step: end of this participant's commands for a step."""

    type: Literal["pass"] = "pass"
    step: Count


class Subscribe(Request):
    """Request for states at every n-th tick of these robots, with these fields (nil: all)."""

    type: Literal["subscribe"] = "subscribe"
    every: Annotated[int, Field(ge=0, le=10_000)] = 1
    robots: Annotated[tuple[Name, ...], Field(max_length=MAX_ROBOTS)] | None = None
    fields: Annotated[tuple[Name, ...], Field(max_length=32)] | None = None


class Signal(Request):
    """Scalar or short vector shared with all clients; the gate never reads it."""

    type: Literal["signal"] = "signal"
    name: Name
    value: Annotated[tuple[Finite, ...], Field(min_length=1, max_length=MAX_SIGNAL)]


class Stop(Request):
    """Stop of one robot, or of the cell."""

    type: Literal["stop"] = "stop"
    robot: Name | None = None
    reason: Text = ""


class Reset(Request):
    """Reset of a stop (operators only)."""

    type: Literal["reset"] = "reset"
    stop: Count


class Ping(Request):
    """Request for a pong; ``time`` is read from the sender's clock and repeated in the answer."""

    type: Literal["ping"] = "ping"
    time: Finite


class Sessions(Request):
    """Request for the sessions of the server (operators only)."""

    type: Literal["sessions"] = "sessions"


class Kick(Request):
    """Request to end a session (operators only)."""

    type: Literal["kick"] = "kick"
    session: Name
    reason: Text = ""


class Bye(Message):
    """Last message of a client or a server."""

    type: Literal["bye"] = "bye"
    reason: Text = ""


# --- from the server --------------------------------------------------------------------------------------


class Answer(Message):
    """Message that may answer a request: ``re`` is the request's ``id``, None if it answers no request."""

    re: Id | None = None


class Limits(Part):
    """Bounds that this server enforces."""

    inbound: Count
    outbound: Count
    max_age_ticks: Count
    lease_ttl: Finite
    signals: Count
    signal_rate: Finite


class Welcome(Answer):
    """Answer to hello: the chosen version, and both version lists to detect a downgrade."""

    type: Literal["welcome"] = "welcome"
    version: Annotated[int, Field(ge=1, le=2**16)]
    versions: Versions
    client_versions: Versions
    capabilities: Capabilities = ()
    start: Name
    session: Name
    name: Name
    role: Role
    lockstep: bool = False
    limits: Limits
    software: Text = ""


class Joint(Part):
    """Joint; its unit follows from its type (rad, m), limits are per s and per s²."""

    name: Name
    kind: Literal["revolute", "prismatic"]
    unit: Literal["rad", "m"]
    lower: Finite
    upper: Finite
    velocity: Finite
    acceleration: Finite
    deceleration: Finite | None


class Shape(Part):
    """Primitive, centred in its frame, with its axis along z; ``size`` by kind, m.

    sphere: radius; capsule, cylinder: radius, length (of a capsule without its caps); box: x, y, z.
    """

    kind: Literal["sphere", "capsule", "cylinder", "box"]
    size: Annotated[tuple[Finite, ...], Field(min_length=1, max_length=3)]


class AssetRef(Part):
    """Reference to large data, available in chunks by its SHA-256."""

    hash: Hash
    size: Count
    media: Text


class Exact(Part):
    """Exact shape of a body that is not a primitive, in the body's frame; later versions may add kinds.

    cone: ``size`` is radius and length, m, with the tip at +length/2. convex: the convex hull of the vertices
    of ``mesh`` (Wavefront OBJ in m, with the triangles of the hull), thickened by ``radius``, m.
    """

    kind: Name
    size: Annotated[tuple[Finite, ...], Field(max_length=3)] = ()
    mesh: AssetRef | None = None
    radius: Finite = 0.0


class Body(Part):
    """Rigid body, on a robot's link or (robot and link nil) fixed in the world.

    Its shape is ``shape``; if ``exact`` is given, the body is contained in ``shape``.
    """

    name: Name
    robot: Name | None
    link: Name | None
    shape: Shape
    xyz: Point
    xyzw: Quaternion
    exact: Exact | None = None


class RobotDescription(Part):
    """Model of one robot for a controller."""

    name: Name
    urdf: AssetRef
    joints: Annotated[tuple[Joint, ...], Field(max_length=MAX_JOINTS)]
    base_xyz: Point
    base_xyzw: Quaternion
    period: Finite
    start: Joints
    frames: Annotated[tuple[Name, ...], Field(max_length=MAX_FRAMES)]
    tool: Name
    camera: Name | None


class Description(Answer):
    """Description of the cell: robots, bodies, distances; ``hash`` changes with any part of it."""

    type: Literal["description"] = "description"
    name: Text
    hash: Hash
    stop_distance: Finite
    self_distance: Finite
    response: Literal["stop", "slow"]
    lockstep: bool
    robots: Annotated[tuple[RobotDescription, ...], Field(max_length=MAX_ROBOTS)]
    bodies: Annotated[tuple[Body, ...], Field(max_length=MAX_BODIES)]


class Chunk(Answer):
    """Piece of an asset."""

    type: Literal["chunk"] = "chunk"
    hash: Hash
    offset: Count
    total: Count
    data: Annotated[bytes, Field(max_length=MAX_CHUNK)]


class Lease(Answer):
    """State of a lease, for its holder or former holder."""

    type: Literal["lease"] = "lease"
    robot: Name
    fence: Count
    state: Literal["held", "released", "lost"]
    ttl: Finite
    speed: Share = 1.0
    reason: Text = ""


class Reason(Part):
    """One cause that limited or refused a command, with its numbers."""

    cause: Name
    text: Text
    joint: Name | None = None
    pair: tuple[Name, Name] | None = None
    value: Finite | None = None
    bound: Finite | None = None
    points: tuple[Point, Point] | None = None


class Verdict(Message):
    """Verdict on one command; each readable command gets exactly one, in the order sent per robot."""

    type: Literal["verdict"] = "verdict"
    robot: Name
    seq: Count
    tick: Count
    target: Count | None
    outcome: Literal["admitted", "limited", "refused"]
    beta: Annotated[float, Field(ge=0.0, le=1.0)]
    dq: Joints
    setpoint: Joints
    reasons: Annotated[tuple[Reason, ...], Field(max_length=MAX_REASONS)] = ()


class Nearest(Part):
    """Distance of two bodies: a certified lower bound at the measured positions."""

    pair: tuple[Name, Name]
    distance: Finite
    limit: Finite
    points: tuple[Point, Point] | None = None


class LastVerdict(Part):
    """Newest verdict of a robot, for clients that did not send the command."""

    seq: Count
    outcome: Literal["admitted", "limited", "refused"]
    cause: Name | None = None
    text: Text = ""


class Entry(Part):
    """State of one robot; fields that were not subscribed are absent."""

    robot: Name
    tick: Count
    time: Finite
    q: Joints | None = None
    setpoint: Joints | None = None
    applied_seq: Count | None = None
    stop_end: Joints | None = None
    nearest: Annotated[tuple[Nearest, ...], Field(max_length=MAX_NEAREST)] | None = None
    least_clearance: Finite | None = None
    holder: Name | None = None
    stops: Annotated[tuple[Count, ...], Field(max_length=MAX_STOPS)] | None = None
    link: Literal["waiting", "ready", "lost", "faulted"] | None = None
    verdict: LastVerdict | None = None
    counts: Annotated[dict[Name, Count], Field(max_length=MAX_COUNTS)] | None = None
    late_commands: Count | None = None


class SignalValue(Part):
    """Newest value of a signal and its owner."""

    owner: Name
    value: Annotated[tuple[Finite, ...], Field(min_length=1, max_length=MAX_SIGNAL)]
    time: Finite


class State(Answer):
    """State of the cell at one tick of ``robot``: an entry per robot, signals and warnings."""

    type: Literal["state"] = "state"
    robot: Name
    tick: Count
    time: Finite
    step: Count | None = None
    entries: Annotated[tuple[Entry, ...], Field(max_length=MAX_ROBOTS)]
    signals: Annotated[dict[Name, SignalValue], Field(max_length=MAX_SIGNALS)] = Field(default_factory=dict)
    warnings: Annotated[tuple[Text, ...], Field(max_length=MAX_WARNINGS)] = ()


class Subscribed(Answer):
    """Subscription now in force."""

    type: Literal["subscribed"] = "subscribed"
    every: Count
    robots: Annotated[tuple[Name, ...], Field(max_length=MAX_ROBOTS)]
    fields: Annotated[tuple[Name, ...], Field(max_length=32)]


class Signaled(Answer):
    """Confirmation that a signal was accepted."""

    type: Literal["signaled"] = "signaled"
    name: Name


class Stopped(Answer):
    """Stop that is now in force; sent to every session. ``replaces``: the stop that it replaces, if any."""

    type: Literal["stopped"] = "stopped"
    stop: Count
    robots: Annotated[tuple[Name, ...], Field(max_length=MAX_ROBOTS)]
    reason: Text
    by: Name
    replaces: Count | None = None


class Resumed(Answer):
    """Stop that was lifted; sent to every session. ``lifted``: the stop that had replaced it, if any."""

    type: Literal["resumed"] = "resumed"
    stop: Count
    by: Name
    lifted: Count | None = None


class Pong(Answer):
    """Answer to ping: the client's time, and the server's times of receipt and answer."""

    type: Literal["pong"] = "pong"
    time: Finite
    received: Finite
    sent: Finite


class SessionInfo(Part):
    """Session: its client, its token (nil: none), its peer address, and the robots that it holds."""

    session: Name
    name: Name
    role: Role
    token: Name | None
    address: Text
    robots: Annotated[tuple[Name, ...], Field(max_length=MAX_ROBOTS)]


class SessionList(Answer):
    """Sessions of the server, in the order in which they began."""

    type: Literal["session_list"] = "session_list"
    sessions: Annotated[tuple[SessionInfo, ...], Field(max_length=MAX_SESSIONS)]


class Kicked(Answer):
    """Confirmation that a session was ended."""

    type: Literal["kicked"] = "kicked"
    session: Name


class Error(Answer):
    """Error in a message of the peer; after a fatal error the connection is closed."""

    type: Literal["error"] = "error"
    code: Name
    text: Text
    fatal: bool
    about: Name | None = None
    seq: Count | None = None


# The two unions are the registry: the catalogues, the codec, the state machine, the tables of SPEC.md, the
# schema and the vectors follow from them, and a type checker finds each dispatch that lacks a member.
ClientMessage = (
    Hello | Describe | Asset | Acquire | Release | Command | Pass | Subscribe | Signal | Stop | Reset | Ping
    | Bye | Sessions | Kick
)  # fmt: skip
ServerMessage = (
    Welcome | Description | Chunk | Lease | Verdict | State | Subscribed
    | Signaled | Stopped | Resumed | Pong | Error | Bye | SessionList | Kicked
)  # fmt: skip
CLIENT_MESSAGES: tuple[type[Message], ...] = get_args(ClientMessage)
SERVER_MESSAGES: tuple[type[Message], ...] = get_args(ServerMessage)

ANSWERS: dict[type[Request], type[Answer]] = {
    Hello: Welcome,
    Describe: Description,
    Asset: Chunk,
    Acquire: Lease,
    Release: Lease,
    Subscribe: Subscribed,
    Signal: Signaled,
    Stop: Stopped,
    Reset: Resumed,
    Ping: Pong,
    Sessions: SessionList,
    Kick: Kicked,
}
"""Type of the answer to each request; any request may get an error instead."""


class Catalogue:
    """Models by ``type``, for each direction."""

    client: ClassVar[dict[str, type[Message]]] = {m.model_fields["type"].default: m for m in CLIENT_MESSAGES}
    server: ClassVar[dict[str, type[Message]]] = {m.model_fields["type"].default: m for m in SERVER_MESSAGES}
