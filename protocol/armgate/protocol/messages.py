"""The messages of protocol version 1: the one place where their form is written.

A message is a msgpack map with a ``type`` and the fields of one model below. Models are strict: a text is
not a number, a bool is not a number, an int is accepted where a float is meant. Unknown keys are ignored.
Every list, text and map is bounded. SPEC.md, the vectors and the JSON Schema are drawn from here.

Units: rad and m for joints (by the joint's type), m for points, s for times. Points and placements of the
surroundings are in the world frame; a quaternion is x, y, z, w.
"""

from typing import Annotated, ClassVar, Literal

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
"""A wish may hold NaN and infinities on the wire: such a command can be read, so it gets a verdict."""
Point = tuple[Finite, Finite, Finite]
Quaternion = tuple[Finite, Finite, Finite, Finite]
Versions = Annotated[tuple[Annotated[int, Field(ge=1, le=2**16)], ...], Field(min_length=1, max_length=16)]
Capabilities = Annotated[tuple[Name, ...], Field(max_length=64)]
Role = Literal["observer", "controller", "operator"]


class Message(BaseModel):
    """What all messages share: strict, immutable, tolerant of keys that a later version adds."""

    model_config = ConfigDict(strict=True, frozen=True, extra="ignore")
    type: str


class Part(BaseModel):
    """A map inside a message."""

    model_config = ConfigDict(strict=True, frozen=True, extra="ignore")


# --- from the client --------------------------------------------------------------------------------------


class Request(Message):
    """A message that is answered: the answer's ``re`` repeats its ``id``."""

    id: Id | None = None


class Hello(Request):
    """First message of a connection: who I am and which versions I speak."""

    type: Literal["hello"] = "hello"
    versions: Versions
    name: Name
    role: Role = "controller"
    token: Token | None = None
    capabilities: Capabilities = ()
    software: Text = ""


class Describe(Request):
    """Asks for the description of the cell."""

    type: Literal["describe"] = "describe"


class Asset(Request):
    """Asks for a piece of an asset that the description names by its hash."""

    type: Literal["asset"] = "asset"
    hash: Hash
    offset: Count = 0
    length: Annotated[int, Field(ge=1, le=MAX_CHUNK)] = MAX_CHUNK


class Acquire(Request):
    """Asks for the lease of a robot; ``speed`` is an own, tighter bound as a fraction of the cell's."""

    type: Literal["acquire"] = "acquire"
    robot: Name
    takeover: bool = False
    speed: Share = 1.0


class Release(Request):
    """Gives a lease back."""

    type: Literal["release"] = "release"
    robot: Name
    fence: Count


class Command(Message):
    """The increment ``dq`` to the setpoint at the robot's next tick, decided on what ``tick`` showed."""

    type: Literal["command"] = "command"
    robot: Name
    fence: Count
    seq: Count
    tick: Count
    dq: Increment
    deadline: Finite | None = None
    horizon: Count | None = None


class Pass(Message):
    """Lock-step: nothing more from this participant for this step."""

    type: Literal["pass"] = "pass"
    step: Count


class Subscribe(Request):
    """Asks for the state: at every n-th tick of these robots, with these fields (nil: all)."""

    type: Literal["subscribe"] = "subscribe"
    every: Annotated[int, Field(ge=0, le=10_000)] = 1
    robots: Annotated[tuple[Name, ...], Field(max_length=MAX_ROBOTS)] | None = None
    fields: Annotated[tuple[Name, ...], Field(max_length=32)] | None = None


class Signal(Request):
    """Shares a scalar or a short vector with the other clients; the gate never reads it."""

    type: Literal["signal"] = "signal"
    name: Name
    value: Annotated[tuple[Finite, ...], Field(min_length=1, max_length=MAX_SIGNAL)]


class Stop(Request):
    """Stops one robot, or the cell."""

    type: Literal["stop"] = "stop"
    robot: Name | None = None
    reason: Text = ""


class Reset(Request):
    """Lifts a stop (operators only)."""

    type: Literal["reset"] = "reset"
    stop: Count


class Ping(Request):
    """Asks for a sign of life; ``time`` is the sender's own clock, repeated in the answer."""

    type: Literal["ping"] = "ping"
    time: Finite


class Sessions(Request):
    """Asks for the sessions of the server (operators only)."""

    type: Literal["sessions"] = "sessions"


class Kick(Request):
    """Ends a session (operators only)."""

    type: Literal["kick"] = "kick"
    session: Name
    reason: Text = ""


class Bye(Message):
    """Last message of either side."""

    type: Literal["bye"] = "bye"
    reason: Text = ""


# --- from the server --------------------------------------------------------------------------------------


class Answer(Message):
    """A message that may answer a request: ``re`` is the request's ``id``, None where nobody asked."""

    re: Id | None = None


class Limits(Part):
    """The bounds that this server keeps."""

    inbound: Count
    outbound: Count
    max_age_ticks: Count
    lease_ttl: Finite
    signals: Count
    signal_rate: Finite


class Welcome(Answer):
    """The answer to hello: the version chosen, and both version lists so that a downgrade shows."""

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
    """One joint: its unit follows from its type (rad, m); limits per s and per s²."""

    name: Name
    kind: Literal["revolute", "prismatic"]
    unit: Literal["rad", "m"]
    lower: Finite
    upper: Finite
    velocity: Finite
    acceleration: Finite
    deceleration: Finite | None


class Shape(Part):
    """A primitive, centred in its frame, its axis along z; ``size`` by kind, m.

    sphere: radius; capsule, cylinder: radius, length (a capsule's without its caps); box: x, y, z.
    """

    kind: Literal["sphere", "capsule", "cylinder", "box"]
    size: Annotated[tuple[Finite, ...], Field(min_length=1, max_length=3)]


class AssetRef(Part):
    """Something large, to be had in chunks by its SHA-256."""

    hash: Hash
    size: Count
    media: Text


class Exact(Part):
    """What a body is that is no primitive, in the body's frame; kinds may be added.

    cone: ``size`` is radius and length, m, its tip at +length/2. convex: the hull of the vertices of ``mesh``
    (Wavefront OBJ in m, with the triangles of the hull), thickened by ``radius``, m.
    """

    kind: Name
    size: Annotated[tuple[Finite, ...], Field(max_length=3)] = ()
    mesh: AssetRef | None = None
    radius: Finite = 0.0


class Body(Part):
    """A rigid body: on a robot's link, or (robot and link nil) standing in the world.

    It is its ``shape``, or, where ``exact`` is given, something inside of it.
    """

    name: Name
    robot: Name | None
    link: Name | None
    shape: Shape
    xyz: Point
    xyzw: Quaternion
    exact: Exact | None = None


class RobotDescription(Part):
    """One robot: everything that a controller needs to model it."""

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
    """The cell: robots, bodies, distances kept; ``hash`` changes whenever any of it does."""

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
    """A piece of an asset."""

    type: Literal["chunk"] = "chunk"
    hash: Hash
    offset: Count
    total: Count
    data: Annotated[bytes, Field(max_length=MAX_CHUNK)]


class Lease(Answer):
    """A lease's state as its holder (or former holder) sees it."""

    type: Literal["lease"] = "lease"
    robot: Name
    fence: Count
    state: Literal["held", "released", "lost"]
    ttl: Finite
    speed: Share = 1.0
    reason: Text = ""


class Reason(Part):
    """One cause that bound a command, with its numbers."""

    cause: Name
    text: Text
    joint: Name | None = None
    pair: tuple[Name, Name] | None = None
    value: Finite | None = None
    bound: Finite | None = None
    points: tuple[Point, Point] | None = None


class Verdict(Message):
    """The judgement of one command: exactly one for each that can be read, in seq order per robot."""

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
    """How near two bodies are: a certified lower bound at the measured positions."""

    pair: tuple[Name, Name]
    distance: Finite
    limit: Finite
    points: tuple[Point, Point] | None = None


class LastVerdict(Part):
    """The newest verdict of a robot, for those who did not send the command."""

    seq: Count
    outcome: Literal["admitted", "limited", "refused"]
    cause: Name | None = None
    text: Text = ""


class Entry(Part):
    """One robot in the state; a field that was not subscribed is left out."""

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
    """The newest value of a signal and who owns it."""

    owner: Name
    value: Annotated[tuple[Finite, ...], Field(min_length=1, max_length=MAX_SIGNAL)]
    time: Finite


class State(Answer):
    """The cell at one tick of ``robot``: an entry per robot, signals and warnings."""

    type: Literal["state"] = "state"
    robot: Name
    tick: Count
    time: Finite
    step: Count | None = None
    entries: Annotated[tuple[Entry, ...], Field(max_length=MAX_ROBOTS)]
    signals: Annotated[dict[Name, SignalValue], Field(max_length=MAX_SIGNALS)] = Field(default_factory=dict)
    warnings: Annotated[tuple[Text, ...], Field(max_length=MAX_WARNINGS)] = ()


class Subscribed(Answer):
    """The subscription now in force."""

    type: Literal["subscribed"] = "subscribed"
    every: Count
    robots: Annotated[tuple[Name, ...], Field(max_length=MAX_ROBOTS)]
    fields: Annotated[tuple[Name, ...], Field(max_length=32)]


class Signaled(Answer):
    """A signal was taken over."""

    type: Literal["signaled"] = "signaled"
    name: Name


class Stopped(Answer):
    """A stop is in force; sent to every session. ``replaces``: the stop whose place it takes, if any."""

    type: Literal["stopped"] = "stopped"
    stop: Count
    robots: Annotated[tuple[Name, ...], Field(max_length=MAX_ROBOTS)]
    reason: Text
    by: Name
    replaces: Count | None = None


class Resumed(Answer):
    """A stop was lifted; sent to every session. ``lifted``: the stop that had replaced it, if any."""

    type: Literal["resumed"] = "resumed"
    stop: Count
    by: Name
    lifted: Count | None = None


class Pong(Answer):
    """The answer to ping: the client's time, and the daemon's times of receipt and answer."""

    type: Literal["pong"] = "pong"
    time: Finite
    received: Finite
    sent: Finite


class SessionInfo(Part):
    """One session: its client, its token (nil: none), where it connects from, the robots that it holds."""

    session: Name
    name: Name
    role: Role
    token: Name | None
    address: Text
    robots: Annotated[tuple[Name, ...], Field(max_length=MAX_ROBOTS)]


class SessionList(Answer):
    """The sessions of the server, in the order in which they came."""

    type: Literal["session_list"] = "session_list"
    sessions: Annotated[tuple[SessionInfo, ...], Field(max_length=MAX_SESSIONS)]


class Kicked(Answer):
    """A session was ended."""

    type: Literal["kicked"] = "kicked"
    session: Name


class Error(Answer):
    """Something was wrong with what the peer sent; after a fatal one the connection is closed."""

    type: Literal["error"] = "error"
    code: Name
    text: Text
    fatal: bool
    about: Name | None = None
    seq: Count | None = None


CLIENT_MESSAGES: tuple[type[Message], ...] = (
    Hello, Describe, Asset, Acquire, Release, Command, Pass, Subscribe, Signal, Stop, Reset, Ping, Bye,
    Sessions, Kick,
)  # fmt: skip
SERVER_MESSAGES: tuple[type[Message], ...] = (
    Welcome, Description, Chunk, Lease, Verdict, State, Subscribed,
    Signaled, Stopped, Resumed, Pong, Error, Bye, SessionList, Kicked,
)  # fmt: skip

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
"""What answers a request, if no error does."""


class Catalogue:
    """Models by ``type`` for each direction."""

    client: ClassVar[dict[str, type[Message]]] = {m.model_fields["type"].default: m for m in CLIENT_MESSAGES}
    server: ClassVar[dict[str, type[Message]]] = {m.model_fields["type"].default: m for m in SERVER_MESSAGES}
