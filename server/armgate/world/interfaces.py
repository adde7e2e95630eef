"""Interfaces of the core to gate, clients and log; for links see `armgate.links.link`.

The core opens no socket, reads no clock and starts no thread. Its caller provides these objects, so that a
daemon, a test or a simulation can run the same core.
"""

from dataclasses import dataclass, field
from functools import cached_property
from types import TracebackType
from typing import Any, Protocol, get_args

from armgate.events import GateEvent, GateOutput
from armgate.gate import RobotView
from armgate.protocol import RemoteProtocolError, encode
from armgate.protocol import messages as m
from armgate.protocol.messages import Message, Role, State

# --- gate ------------------------------------------------------------------------------------------------


class Gate(Protocol):
    """The gate of a cell."""

    def step(self, event: GateEvent) -> list[GateOutput]:
        """Process one event; return the outputs in order."""

    def view(self, robot: str) -> RobotView:
        """Return the gate's view of one robot."""

    def warnings(self) -> tuple[str, ...]:
        """Return warnings that concern no single robot."""


# --- clients ----------------------------------------------------------------------------------------------

ClientRequest = (
    m.Acquire
    | m.Asset
    | m.Command
    | m.Describe
    | m.Kick
    | m.Pass
    | m.Ping
    | m.Release
    | m.Reset
    | m.Sessions
    | m.Signal
    | m.Stop
    | m.Subscribe
)
"""Every message of a client except hello and bye, which the session answers."""

REQUESTS: frozenset[type] = frozenset(get_args(ClientRequest))
"""The types of these messages: looking one up is faster than ``isinstance`` with a union."""


@dataclass(frozen=True, slots=True)
class Client:
    """A client after its hello.

    Attributes:
        id: Id of its session.
        name: Name from its hello.
        role: Role that was granted.
        robots: Robots that it may command; None: all.
        identity: Its token, or its address if it has no token; rate limits and turns count by identity.
        token: Name of its token; None without one.
        known_as: Name of its token, or ``uid N`` on the Unix socket; None if only its own name is known.
        address: Address that it connects from.
        capabilities: Capabilities that it named in its hello.
    """

    id: str
    name: str
    role: Role
    robots: frozenset[str] | None = None
    identity: str = ""
    token: str | None = None
    known_as: str | None = None
    address: str = ""
    capabilities: frozenset[str] = field(default_factory=frozenset)


@dataclass(frozen=True, eq=False)
class Encoded:
    """A state and its frame, which is encoded at its first use: once for many clients."""

    state: State

    @cached_property
    def frame(self) -> bytes:
        """Frame of the state."""
        return encode(self.state)


class Batch(Protocol):
    """Frames to one client that are written together when the batch closes; see `Peer.batch`."""

    def close(self) -> None:
        """End the batch; the last open batch of a client writes the frames that were held back."""

    def flush(self) -> None:
        """Write all frames that were held back, even if another batch of the client is open."""

    def __enter__(self) -> "Batch": ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


class Peer(Protocol):
    """The connection of one client after its hello."""

    @property
    def client(self) -> Client:
        """The client."""

    def send(self, message: Message, frame: bytes | None = None) -> None:
        """Send a message that may not be dropped; ``frame`` is the message if it is encoded already."""

    def send_states(self, *states: Encoded) -> None:
        """Send states; each replaces an older unsent one of the same robot."""

    def keep_states(self) -> None:
        """Send every state from now on, in order, without replacing or dropping any."""

    def drop_states(self) -> None:
        """Drop unsent states: they belong to a subscription that has ended."""

    def batch(self) -> Batch:
        """Hold back states, and messages that may be delayed, until the batch closes."""

    def close(self, message: Message) -> None:
        """Send a last message, then close the connection."""

    def expel(self, error: RemoteProtocolError) -> None:
        """Send an error, close the connection and end the session at once."""


class EventLog(Protocol):
    """Structured log."""

    def info(self, event: str, **fields: Any) -> None:
        """Log a normal event."""

    def warning(self, event: str, **fields: Any) -> None:
        """Log an event that needs attention."""

    def error(self, event: str, **fields: Any) -> None:
        """Log a failure."""


class RequestHandler(Protocol):
    """Receiver of the requests of all sessions.

    There are two receivers. By the wall clock and with a robot server it is the `Core` itself. In lock-step
    it is `Lockstep`, which keeps some requests until a later step and then passes them to the core. The
    daemon chooses (`lifecycle.daemon`), and a session calls it directly.
    """

    def join(self, peer: Peer) -> None:
        """Register a session after its hello.

        Raises:
            RemoteProtocolError: The session cannot take part; close it with this error.
        """

    def handle(self, peer: Peer, request: ClientRequest) -> None:
        """Process a request; errors go to the client."""

    def leave(self, peer: Peer) -> None:
        """Remove a session that has ended."""
