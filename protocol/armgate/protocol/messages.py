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
    """Number of the request, repeated as `re` in its answer."""


class Hello(Request):
    """First message of a connection: name, role and supported versions of the client."""

    type: Literal["hello"] = "hello"
    versions: Versions
    """Versions that the client supports."""
    name: Name
    """Name of the client, visible to other clients."""
    role: Role = "controller"
    """Requested role."""
    token: Token | None = None
    """Token, if the server requires one."""
    capabilities: Capabilities = ()
    """Additions that the client supports."""
    software: Text = ""
    """Name and version of the client's software."""


class Describe(Request):
    """Request for the description of the cell."""

    type: Literal["describe"] = "describe"


class Asset(Request):
    """Request for a piece of an asset, named by the hash in the description."""

    type: Literal["asset"] = "asset"
    hash: Hash
    """SHA-256 of the asset."""
    offset: Count = 0
    """First byte of the piece."""
    length: Annotated[int, Field(ge=1, le=MAX_CHUNK)] = MAX_CHUNK
    """Largest length of the piece, bytes."""


class Acquire(Request):
    """Request for the lease of a robot; ``speed`` is a tighter speed bound, a share of the cell's."""

    type: Literal["acquire"] = "acquire"
    robot: Name
    """Name of the robot."""
    takeover: bool = False
    """Take the robot over from its holder (operators only)."""
    speed: Share = 1.0
    """Speed bound, a share of the cell's."""


class Release(Request):
    """Release of a lease."""

    type: Literal["release"] = "release"
    robot: Name
    """Name of the robot."""
    fence: Count
    """Fence of the lease."""


class Command(Message):
    """Increment ``dq`` to the setpoint at the robot's next tick, based on the state at ``tick``."""

    type: Literal["command"] = "command"
    robot: Name
    """Name of the robot."""
    fence: Count
    """Fence of the lease."""
    seq: Count
    """Number of the command, repeated in its verdict."""
    tick: Count
    """Tick of the state that the command is based on."""
    dq: Increment
    """Increment to the setpoint, rad or m by joint."""
    deadline: Finite | None = None
    """Reserved."""
    horizon: Count | None = None
    """Reserved."""


class Pass(Message):
    """Lock-step: end of this participant's commands for a step."""

    type: Literal["pass"] = "pass"
    step: Count
    """Number of the step."""


class Subscribe(Request):
    """Request for states at every n-th tick of these robots, with these fields (nil: all)."""

    type: Literal["subscribe"] = "subscribe"
    every: Annotated[int, Field(ge=0, le=10_000)] = 1
    """Number of ticks from one state to the next; 0 ends the subscription."""
    robots: Annotated[tuple[Name, ...], Field(max_length=MAX_ROBOTS)] | None = None
    """Names of the robots; None: all."""
    fields: Annotated[tuple[Name, ...], Field(max_length=32)] | None = None
    """Fields of each entry; None: all."""


class Signal(Request):
    """Scalar or short vector shared with all clients; the gate never reads it."""

    type: Literal["signal"] = "signal"
    name: Name
    """Name of the signal."""
    value: Annotated[tuple[Finite, ...], Field(min_length=1, max_length=MAX_SIGNAL)]
    """The numbers."""


class Stop(Request):
    """Stop of one robot, or of the cell."""

    type: Literal["stop"] = "stop"
    robot: Name | None = None
    """Name of the robot; None: all robots."""
    reason: Text = ""
    """Reason, shown to all clients."""


class Reset(Request):
    """Reset of a stop (operators only)."""

    type: Literal["reset"] = "reset"
    stop: Count
    """Id of the stop."""


class Ping(Request):
    """Request for a pong; ``time`` is read from the sender's clock and repeated in the answer."""

    type: Literal["ping"] = "ping"
    time: Finite
    """Time of the sender's clock."""


class Sessions(Request):
    """Request for the sessions of the server (operators only)."""

    type: Literal["sessions"] = "sessions"


class Kick(Request):
    """Request to end a session (operators only)."""

    type: Literal["kick"] = "kick"
    session: Name
    """Id of the session."""
    reason: Text = ""
    """Reason, sent to its client."""


class Bye(Message):
    """Last message of a client or a server."""

    type: Literal["bye"] = "bye"
    reason: Text = ""
    """Reason for the end of the session."""


# --- from the server --------------------------------------------------------------------------------------


class Answer(Message):
    """Message that may answer a request: ``re`` is the request's ``id``, None if it answers no request."""

    re: Id | None = None
    """`id` of the request; None if the message answers no request."""


class Limits(Part):
    """Bounds that this server enforces."""

    inbound: Count
    """Longest payload from a client, bytes."""
    outbound: Count
    """Longest payload from the server, bytes."""
    max_age_ticks: Count
    """Largest age of the tick that a command is based on, ticks."""
    lease_ttl: Finite
    """Time to live of a lease, s."""
    signals: Count
    """Largest number of signals of one session."""
    signal_rate: Finite
    """Largest number of signals of one session per second."""


class Welcome(Answer):
    """Answer to hello: the chosen version, and both version lists to detect a downgrade."""

    type: Literal["welcome"] = "welcome"
    version: Annotated[int, Field(ge=1, le=2**16)]
    """Chosen version of the protocol."""
    versions: Versions
    """Versions that the server supports."""
    client_versions: Versions
    """Versions in the client's hello, as the server read them."""
    capabilities: Capabilities = ()
    """Additions that the server supports."""
    start: Name
    """Id of this start of the server."""
    session: Name
    """Id of the session."""
    name: Name
    """Name of the client."""
    role: Role
    """Role of the session."""
    lockstep: bool = False
    """True if the server runs in lock-step."""
    limits: Limits
    """Bounds that the server enforces."""
    software: Text = ""
    """Name and version of the server's software."""


class Joint(Part):
    """Joint; its unit follows from its type (rad, m), limits are per s and per s²."""

    name: Name
    """Name of the joint."""
    kind: Literal["revolute", "prismatic"]
    """Type of the joint."""
    unit: Literal["rad", "m"]
    """Unit of its positions."""
    lower: Finite
    """Lower position limit, rad or m."""
    upper: Finite
    """Upper position limit, rad or m."""
    velocity: Finite
    """Speed limit, rad/s or m/s."""
    acceleration: Finite
    """Acceleration limit, rad/s² or m/s²."""
    deceleration: Finite | None
    """Deceleration limit, rad/s² or m/s²; None: the joint stops at once."""


class Shape(Part):
    """Primitive, centred in its frame, with its axis along z; ``size`` by kind, m.

    sphere: radius; capsule, cylinder: radius, length (of a capsule without its caps); box: x, y, z.
    """

    kind: Literal["sphere", "capsule", "cylinder", "box"]
    """Kind of the primitive."""
    size: Annotated[tuple[Finite, ...], Field(min_length=1, max_length=3)]
    """Sizes by kind, m."""


class AssetRef(Part):
    """Reference to large data, available in chunks by its SHA-256."""

    hash: Hash
    """SHA-256 of the data, in hexadecimal digits."""
    size: Count
    """Size of the data, bytes."""
    media: Text
    """Media type of the data."""


class Exact(Part):
    """Exact shape of a body that is not a primitive, in the body's frame; later versions may add kinds.

    cone: ``size`` is radius and length, m, with the tip at +length/2. convex: the convex hull of the vertices
    of ``mesh`` (Wavefront OBJ in m, with the triangles of the hull), thickened by ``radius``, m.
    """

    kind: Name
    """Kind of the shape."""
    size: Annotated[tuple[Finite, ...], Field(max_length=3)] = ()
    """Sizes by kind, m."""
    mesh: AssetRef | None = None
    """Vertices of a convex hull."""
    radius: Finite = 0.0
    """Thickness around the hull, m."""


class Body(Part):
    """Rigid body, on a robot's link or (robot and link nil) fixed in the world.

    Its shape is ``shape``; if ``exact`` is given, the body is contained in ``shape``.
    """

    name: Name
    """Name of the body."""
    robot: Name | None
    """Robot that it belongs to; None: fixed in the world."""
    link: Name | None
    """Link of the robot in whose frame its pose is stated."""
    shape: Shape
    """Primitive that contains the body."""
    xyz: Point
    """Position, m."""
    xyzw: Quaternion
    """Orientation, a quaternion."""
    exact: Exact | None = None
    """Exact shape, if it is not a primitive."""


class RobotDescription(Part):
    """Model of one robot for a controller."""

    name: Name
    """Name of the robot."""
    urdf: AssetRef
    """URDF of the robot, an asset."""
    joints: Annotated[tuple[Joint, ...], Field(max_length=MAX_JOINTS)]
    """Joints, in the order of all joint values."""
    base_xyz: Point
    """Position of the URDF's root in the world, m."""
    base_xyzw: Quaternion
    """Orientation of the URDF's root in the world, a quaternion."""
    period: Finite
    """Period of the robot's clock, s."""
    start: Joints
    """Position at the start of the server, rad or m by joint."""
    frames: Annotated[tuple[Name, ...], Field(max_length=MAX_FRAMES)]
    """Links of the URDF."""
    tool: Name
    """Frame of the tool."""
    camera: Name | None
    """Frame of the camera, which points along its z axis; None: no camera."""


class Description(Answer):
    """Description of the cell: robots, bodies, distances; ``hash`` changes with any part of it."""

    type: Literal["description"] = "description"
    name: Text
    """Name of the cell."""
    hash: Hash
    """Hash of the description."""
    stop_distance: Finite
    """Distance kept between robots, and between robots and surroundings, m."""
    self_distance: Finite
    """Distance kept between bodies of one robot, m."""
    response: Literal["stop", "slow"]
    """Response to a command that would violate a distance: refuse it (`stop`) or reduce it (`slow`)."""
    lockstep: bool
    """True if the server runs in lock-step."""
    robots: Annotated[tuple[RobotDescription, ...], Field(max_length=MAX_ROBOTS)]
    """Robots of the cell."""
    bodies: Annotated[tuple[Body, ...], Field(max_length=MAX_BODIES)]
    """Bodies of robots and surroundings."""


class Chunk(Answer):
    """Piece of an asset."""

    type: Literal["chunk"] = "chunk"
    hash: Hash
    """SHA-256 of the asset."""
    offset: Count
    """First byte of the piece."""
    total: Count
    """Size of the asset, bytes."""
    data: Annotated[bytes, Field(max_length=MAX_CHUNK)]
    """Bytes of the piece."""


class Lease(Answer):
    """State of a lease, for its holder or former holder."""

    type: Literal["lease"] = "lease"
    robot: Name
    """Name of the robot."""
    fence: Count
    """Number of the lease; commands must contain it."""
    state: Literal["held", "released", "lost"]
    """State of the lease."""
    ttl: Finite
    """Time to live without a message of the holder, s."""
    speed: Share = 1.0
    """Speed bound, a share of the cell's."""
    reason: Text = ""
    """Reason for a loss."""


class Reason(Part):
    """One cause that limited or refused a command, with its numbers."""

    cause: Name
    """Check that applied, such as `clearance`."""
    text: Text
    """Explanation in one sentence."""
    joint: Name | None = None
    """Joint whose bound applied."""
    pair: tuple[Name, Name] | None = None
    """Names of the two bodies whose clearance applied."""
    value: Finite | None = None
    """Value requested or found (rad, m, ticks; by cause)."""
    bound: Finite | None = None
    """Bound that the value was compared with."""
    points: tuple[Point, Point] | None = None
    """Witness points on both bodies, m."""


class Verdict(Message):
    """Verdict on one command; each readable command gets exactly one, in the order sent per robot."""

    type: Literal["verdict"] = "verdict"
    robot: Name
    """Name of the robot."""
    seq: Count
    """Number of the command."""
    tick: Count
    """Tick that the command was based on."""
    target: Count | None
    """Tick at which the increment is to be played; None if an admission check refused the command."""
    outcome: Literal["admitted", "limited", "refused"]
    """Outcome of the command."""
    beta: Annotated[float, Field(ge=0.0, le=1.0)]
    """Blend between the braking increment (0) and the requested increment (1)."""
    dq: Joints
    """Increment at the next tick, rad or m by joint."""
    setpoint: Joints
    """Setpoint after that increment, rad or m by joint."""
    reasons: Annotated[tuple[Reason, ...], Field(max_length=MAX_REASONS)] = ()
    """Causes that applied; empty if admitted."""


class Nearest(Part):
    """Distance of two bodies: a certified lower bound at the measured positions."""

    pair: tuple[Name, Name]
    """Names of the two bodies."""
    distance: Finite
    """Certified lower bound of the distance, m."""
    limit: Finite
    """Distance that is kept, m."""
    points: tuple[Point, Point] | None = None
    """Witness points on both bodies, m; None if only the bound is known."""


class LastVerdict(Part):
    """Newest verdict of a robot, for clients that did not send the command."""

    seq: Count
    """Number of the command."""
    outcome: Literal["admitted", "limited", "refused"]
    """Outcome of the command."""
    cause: Name | None = None
    """Cause of the first reason."""
    text: Text = ""
    """Text of the first reason."""


class Entry(Part):
    """State of one robot; fields that were not subscribed are absent."""

    robot: Name
    """Name of the robot."""
    tick: Count
    """Newest tick of the robot."""
    time: Finite
    """Daemon time of that tick, s."""
    q: Joints | None = None
    """Measured position, rad or m by joint."""
    setpoint: Joints | None = None
    """Commanded position, rad or m by joint."""
    applied_seq: Count | None = None
    """Number of the command whose increment was played last."""
    stop_end: Joints | None = None
    """Position at which the robot comes to rest without a further command."""
    nearest: Annotated[tuple[Nearest, ...], Field(max_length=MAX_NEAREST)] | None = None
    """Nearest pairs of bodies."""
    least_clearance: Finite | None = None
    """Smallest distance to another robot or the surroundings since the start of the server, m."""
    holder: Name | None = None
    """Name of the session that holds the robot; None if no session holds it."""
    stops: Annotated[tuple[Count, ...], Field(max_length=MAX_STOPS)] | None = None
    """Ids of the stops in force for the robot."""
    link: Literal["waiting", "ready", "lost", "faulted"] | None = None
    """State of the robot's link."""
    verdict: LastVerdict | None = None
    """Newest verdict on a command for the robot."""
    counts: Annotated[dict[Name, Count], Field(max_length=MAX_COUNTS)] | None = None
    """Number of verdicts by outcome and last cause, such as `refused:stale`."""
    late_commands: Count | None = None
    """Number of commands that were admitted or limited but arrived too late."""


class SignalValue(Part):
    """Newest value of a signal and its owner."""

    owner: Name
    """Name of the client that set the signal."""
    value: Annotated[tuple[Finite, ...], Field(min_length=1, max_length=MAX_SIGNAL)]
    """Newest value."""
    time: Finite
    """Daemon time at which it was set, s."""


class State(Answer):
    """State of the cell at one tick of ``robot``: an entry per robot, signals and warnings."""

    type: Literal["state"] = "state"
    robot: Name
    """Robot at whose tick the state was produced."""
    tick: Count
    """Number of that tick."""
    time: Finite
    """Daemon time of that tick, s."""
    step: Count | None = None
    """Number of the step in lock-step; None by the wall clock."""
    entries: Annotated[tuple[Entry, ...], Field(max_length=MAX_ROBOTS)]
    """Entries of all robots."""
    signals: Annotated[dict[Name, SignalValue], Field(max_length=MAX_SIGNALS)] = Field(default_factory=dict)
    """Signals by name."""
    warnings: Annotated[tuple[Text, ...], Field(max_length=MAX_WARNINGS)] = ()
    """Warnings of the daemon."""


class Subscribed(Answer):
    """Subscription now in force."""

    type: Literal["subscribed"] = "subscribed"
    every: Count
    """Number of ticks from one state to the next."""
    robots: Annotated[tuple[Name, ...], Field(max_length=MAX_ROBOTS)]
    """Robots of the subscription."""
    fields: Annotated[tuple[Name, ...], Field(max_length=32)]
    """Fields of each entry."""


class Signaled(Answer):
    """Confirmation that a signal was accepted."""

    type: Literal["signaled"] = "signaled"
    name: Name
    """Name of the signal."""


class Stopped(Answer):
    """Stop that is now in force; sent to every session. ``replaces``: the stop that it replaces, if any."""

    type: Literal["stopped"] = "stopped"
    stop: Count
    """Id of the stop."""
    robots: Annotated[tuple[Name, ...], Field(max_length=MAX_ROBOTS)]
    """Stopped robots."""
    reason: Text
    """Reason for the stop."""
    by: Name
    """Name of the client that requested it."""
    replaces: Count | None = None
    """Id of the stop that it replaced."""


class Resumed(Answer):
    """Stop that was lifted; sent to every session. ``lifted``: the stop that had replaced it, if any."""

    type: Literal["resumed"] = "resumed"
    stop: Count
    """Id of the stop in the request."""
    by: Name
    """Name of the client that reset it."""
    lifted: Count | None = None
    """Id of the stop that had replaced it and was lifted."""


class Pong(Answer):
    """Answer to ping: the client's time, and the server's times of receipt and answer."""

    type: Literal["pong"] = "pong"
    time: Finite
    """Time in the ping."""
    received: Finite
    """Server time at which the ping arrived, s."""
    sent: Finite
    """Server time at which the pong was sent, s."""


class SessionInfo(Part):
    """Session: its client, its token (nil: none), its peer address, and the robots that it holds."""

    session: Name
    """Id of the session."""
    name: Name
    """Name of the client."""
    role: Role
    """Role of the session."""
    token: Name | None
    """Name of its token; None: no token."""
    address: Text
    """Address of the client."""
    robots: Annotated[tuple[Name, ...], Field(max_length=MAX_ROBOTS)]
    """Robots that it holds."""


class SessionList(Answer):
    """Sessions of the server, in the order in which they began."""

    type: Literal["session_list"] = "session_list"
    sessions: Annotated[tuple[SessionInfo, ...], Field(max_length=MAX_SESSIONS)]
    """The sessions."""


class Kicked(Answer):
    """Confirmation that a session was ended."""

    type: Literal["kicked"] = "kicked"
    session: Name
    """Id of the session."""


class Error(Answer):
    """Error in a message of the peer; after a fatal error the connection is closed."""

    type: Literal["error"] = "error"
    code: Name
    """Error code."""
    text: Text
    """Explanation for people."""
    fatal: bool
    """True if the connection ends."""
    about: Name | None = None
    """Type of the message concerned."""
    seq: Count | None = None
    """`seq` of the command concerned."""


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
