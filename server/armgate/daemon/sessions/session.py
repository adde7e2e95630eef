"""One client's connection: bytes to messages, and what it is sent."""

import asyncio
from collections.abc import Callable, Sequence
from typing import Protocol

from armgate.daemon.auth.tokens import Token
from armgate.daemon.core.peer import Encoded, Subscription
from armgate.daemon.sessions.connection_limits import Slot
from armgate.daemon.sessions.listener import ConnectionProtocol
from armgate.daemon.sessions.outbox import Outbox, Overflow
from armgate.daemon.sessions.peer_socket import TcpPeerSocket, UnixPeerSocket, peer_socket
from armgate.daemon.sessions.rate_limits import RateLimit
from armgate.daemon.sessions.scheduler import FairScheduler
from armgate.daemon.token_bucket import TokenBucket
from armgate.protocol import (
    DIALECTS,
    Connection,
    ConnectionState,
    Dialect,
    ErrorCode,
    LocalProtocolError,
    Refusal,
    RemoteProtocolError,
    Side,
)
from armgate.protocol import messages as m

_LINGER = 1.0
"""How long a client may take to read the last message, s."""

_LOOK = 0.02
"""Time between two looks at a client for which states wait, s."""

_WATCH = 5.0
"""Time between two looks whether the client's system still answers, s."""

_ROOM = 16 * 1024
"""Bytes that are read at once: asyncio's own 256 KiB are memory that the system makes anew each time."""

_DISCARD = 0.01
"""Time between two reads of a connection that is closing, s: what a client still sends costs little then."""

_AT_ONCE = 8
"""Messages of one client that are read at once: then other clients have their turn."""

_PATIENT = (m.Signaled, m.Verdict)
"""Answers that may wait for what comes with them; nothing else said is held up."""

_COSTS: dict[type[object], float] = {
    Refusal: 2, m.Describe: 20, m.Asset: 20, m.Sessions: 20,
    m.Stop: 8, m.Reset: 8, m.Subscribe: 4, m.Acquire: 2, m.Release: 2,
}  # fmt: skip
"""What counts as more than one message: the answer is large, goes to all clients, or takes long to write."""

_EVICTED = "no hello came while others waited for the place; say hello at once after connecting"

_AHEAD = 256 * 1024
"""Bytes of a client that are kept while it waits for its turn, to find a stop among them."""

_STOPS = 20.0
"""Stops of a client that are acted on ahead of its other messages, per second and at once."""

_BYTES = 2048
"""Bytes that count as one more message, and after which a turn's worth is read."""


class SessionOwner(Protocol):
    """Who sessions turn to."""

    def opened(self, session: "Session") -> None:
        """A connection was made."""

    def hello(self, session: "Session", hello: m.Hello) -> None:
        """A client said who it is: answer with welcome or a fatal error."""

    def said(self, session: "Session", message: m.Message) -> None:
        """A client said something after its hello."""

    def gone(self, session: "Session", reason: str) -> None:
        """A connection is gone or said bye; called once."""

    def closed(self, session: "Session") -> None:
        """A connection is closed; nothing is called for it any more."""

    def privileged(self, session: "Session") -> bool:
        """Return True if the session is served first: it holds a robot, or is an operator by token."""

    def failed(self, error: Exception) -> None:
        """Something of ours failed."""


class Session(asyncio.BufferedProtocol, ConnectionProtocol):
    """A connection and, once it has said hello, the peer behind it.

    Args:
        desk: Who is told.
        number: Count of the connection, for the log.
        guest: Where the client connects from, and whether it may stay.
        send_buffer: Bytes of answers and verdicts that may wait for this client.
        turns: Gives the turns in which it is read.
        allowance: Messages that are read per second on average; None: no bound.
        dialects: The versions of the protocol to speak.

    Attributes:
        identity: The token or address that limits and turns count by.
        robots: The robots that the client may command, None: all.
        token: By which token it came in, None: without one.
    """

    def __init__(
        self,
        desk: SessionOwner,
        number: int,
        guest: Slot,
        send_buffer: int,
        turns: FairScheduler,
        *,
        allowance: RateLimit | None = None,
        dialects: Sequence[Dialect] = DIALECTS,
    ) -> None:
        self.number = number
        self.guest = guest
        self.identity = guest.origin
        self.id = ""
        self.name = ""
        self.role: m.Role = "observer"
        self.robots: frozenset[str] | None = None
        self.token: Token | None = None
        self.subscription: Subscription | None = None
        self.address = ""
        self._desk = desk
        self._connection = Connection(Side.SERVER, dialects)
        self._room = memoryview(bytearray(_ROOM))
        self._outbox = Outbox(self._write, send_buffer, self._reads)
        self._transport: asyncio.Transport
        self._line: TcpPeerSocket | UnixPeerSocket
        self._looking: asyncio.TimerHandle | None = None
        self._watching: asyncio.TimerHandle | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._turns = turns
        self._allowance = allowance
        self._bytes = 0
        self._overtaking = TokenBucket(_STOPS, _STOPS, 0.0)
        self._reading = self._searching = self._ended = self._lost = False
        self._pause: asyncio.TimerHandle | None = None
        self._closing = self._told_gone = self._told_closed = False
        self._overflow = ""
        self._holds = 0
        self._held: list[bytes] = []

    @property
    def version(self) -> int | None:
        """The version of the protocol that is spoken, None before the hello."""
        return self._connection.version

    @property
    def capabilities(self) -> frozenset[str]:
        """The capabilities that the client named in its hello."""
        return self._connection.capabilities

    @property
    def greeted(self) -> bool:
        """Whether the client has been welcomed."""
        return bool(self.id)

    @property
    def token_name(self) -> str | None:
        """Name of the client's token, None without one."""
        return None if self.token is None else self.token.name

    @property
    def known_as(self) -> str | None:
        """Name of the token, or ``uid N`` on the Unix socket; None if only the name is known."""
        return self.guest.origin if self.token is None and self.guest.uid is not None else self.token_name

    @property
    def certificate(self) -> bytes | None:
        """The client's certificate in DER, None if it showed none."""
        tls = self._transport.get_extra_info("ssl_object")
        return None if tls is None else tls.getpeercert(binary_form=True)

    @property
    def unread(self) -> int:
        """How many bytes wait here for a client that reads slowly."""
        return self._outbox.size

    # --- asyncio ------------------------------------------------------------------------------------------

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """A client connected."""
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        # What waits waits in the outbox. Not high=0: TLS pauses at once then, and for ever.
        transport.set_write_buffer_limits(high=1, low=0)
        try:
            self._line = peer_socket(transport.get_extra_info("socket"))
        except OSError:  # the connection is lost already
            self.abort()
            return
        self._watch_on()
        self.address = _address(self.guest, transport.get_extra_info("peername"))
        self._guarded(self._desk.opened, self)

    def get_buffer(self, sizehint: int) -> memoryview:
        """Where bytes may be put that came in."""
        return self._room

    def buffer_updated(self, nbytes: int) -> None:
        """So many bytes came in."""
        self.data_received(bytes(self._room[:nbytes]))

    def data_received(self, data: bytes) -> None:
        """These bytes came in."""
        if self._closing:
            self._read_later()
        else:
            self.guest.silent = False
            self._connection.push(data)
            self._bytes += len(data)
            if self._reading:
                self._read_ahead()
            else:
                self._reading = True
                self._ask_for_turn(self._turns.now)

    def _read_later(self) -> None:
        if self._pause is not None:
            self._pause.cancel()
        if not self._transport.is_closing():
            self._transport.pause_reading()
            self._pause = asyncio.get_running_loop().call_later(_DISCARD, self._read_on)

    def _read_on(self) -> None:
        """Read again, unless the transport is closed: that of TLS fails then."""
        if not self._transport.is_closing():
            self._transport.resume_reading()

    def eof_received(self) -> bool:
        """Handle the end of the client's stream once all that came before is read.

        Returns:
            True if the transport shall stay open until then; TLS cannot.
        """
        self._ended = True
        if not self._reading:
            self._end_of_stream()
        return self._reading and self._transport.can_write_eof()

    def connection_lost(self, exc: Exception | None) -> None:
        """Handle the loss of the connection; after an end of the stream what came before is read first."""
        self.allow(None)
        for timer in (self._looking, self._watching):
            if timer is not None:
                timer.cancel()
        self._lost = True
        if exc is None and self._ended and self._reading and not self._closing:
            return
        self._closing = True
        if self._pause is not None:
            self._pause.cancel()
        self._leave(self._overflow or ("connection lost" if exc is None else str(exc)))
        self._tell_closed()

    def pause_writing(self) -> None:
        """Let everything wait: the kernel takes no more."""
        self._outbox.pause()

    def resume_writing(self) -> None:
        """Write what waits: the kernel takes it again."""
        self._outbox.resume()
        self._look_later()
        if self._closing:
            self._write_eof()

    def _watch(self) -> None:
        """End the connection if the client's system has vanished; a client that only does not read stays."""
        if self._line.vanished():
            self._overflow = f"no answer from {self.address}"
            self.abort()
        else:
            self._watch_on()

    def _watch_on(self) -> None:
        self._watching = asyncio.get_running_loop().call_later(_WATCH, self._watch)

    def identify(self, identity: str) -> None:
        """Count in this identity's limits and turns from now on."""
        self.identity = identity
        if self._allowance is not None:
            self._allowance.identify(identity)

    # --- for desk and core --------------------------------------------------------------------------------

    def say(self, message: m.Message, frame: bytes | None = None) -> None:
        """Send a message that may not be dropped; close if too many of them wait."""
        if self._closing:
            return
        try:
            self._outbox.put(self._connection.send(message, frame))
            if self._holds and not isinstance(message, _PATIENT):
                self._write_held()
        except LocalProtocolError:
            # It said bye, broke the protocol, or never said hello: it is owed nothing any more. Anything else
            # is a defect of ours.
            if self.greeted and self._connection.state is ConnectionState.READY:
                raise
        except Overflow as error:
            # Its end is told at the next turn of the event loop: here the core may be telling many sessions.
            self._overflow = f"{ErrorCode.OVERFLOW}: {error}"
            self.abort()

    def show(self, *states: Encoded) -> None:
        """Send states, each in place of an older one of the same robot that still waits."""
        if not self._closing:
            self._outbox.put_states(
                {state.state.robot: self._connection.send(state.state, state.frame) for state in states}
            )
            self._look_later()

    def _reads(self) -> bool:
        return self._transport.is_closing() or self._line.has_room()

    def _look_later(self) -> None:
        """Look again whether the client reads, if states wait for that."""
        if self._looking is None and self._outbox.states_wait:
            self._looking = asyncio.get_running_loop().call_later(_LOOK, self._look)

    def _look(self) -> None:
        self._looking = None
        if not self._closing:
            self._outbox.write_states()
            self._look_later()

    def drop_states(self) -> None:
        """Drop the states that wait: they belong to a subscription that has ended."""
        self._outbox.drop_states()

    def hold(self) -> None:
        """Let states, and what of answers may wait, wait until as many `let_go` followed: they go as one."""
        self._holds += 1

    def let_go(self) -> None:
        """The opposite of `hold`."""
        self._holds -= 1
        if not self._holds:
            self._write_held()

    def flush(self) -> None:
        """Write what waits because of `hold`, though it is held on."""
        self._write_held()

    def end(self, message: m.Message) -> None:
        """Send a last message and close."""
        self.say(message)
        self._close()

    def evict(self) -> None:
        """Close, to make room for another connection: no hello came."""
        self.end(RemoteProtocolError(ErrorCode.HANDSHAKE_TIMEOUT, _EVICTED).message())

    def expel(self, error: RemoteProtocolError) -> None:
        """End the session at once, also its leases: its client need not have read why."""
        self.end(error.message())
        self._leave(f"{error.code}: {error.text}")

    def abort(self) -> None:
        """Close at once; what was not yet sent is lost."""
        self._closing = True
        self._transport.abort()

    def serve(self, work: Callable[[], None]) -> None:
        """Do work of this connection when it is its turn."""
        self._turns.now(self.identity, self._desk.privileged(self), work)

    def allow(self, seconds: float | None, error: RemoteProtocolError | None = None) -> None:
        """Close with ``error`` unless this is called again within ``seconds``; None: no limit."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if seconds is not None and error is not None:
            loop = asyncio.get_running_loop()
            self._timer = loop.call_later(seconds, lambda: self.end(error.message()))

    # --- inside -------------------------------------------------------------------------------------------

    def _ask_for_turn(self, give: Callable[[str, bool, Callable[[], None]], None]) -> None:
        """Read when it is this session's turn, and when its allowance permits it."""
        privileged = self._desk.privileged(self)
        # Others must not delay a hello: before it only the session's own allowance counts.
        alone = privileged or not self.greeted
        wait = 0.0 if self._allowance is None else self._allowance.reserve(alone)
        if wait:
            self._read_ahead()
            self._pause = asyncio.get_running_loop().call_later(wait, self._resume)
        else:
            give(self.identity, privileged, self._read)

    def _resume(self) -> None:
        self._turns.now(self.identity, self._desk.privileged(self), self._read)

    def _read(self) -> None:
        """Read a turn's worth; the rest when other clients had their turn."""
        self.hold()
        cost, more = self._hear_some()
        self.let_go()
        if self._allowance is not None:
            self._allowance.spend(cost - 1.0, self._desk.privileged(self))
        if more:
            self._read_ahead()
            self._ask_for_turn(self._turns.later)
            return
        self._reading = False
        if self._ended:
            self._end_of_stream()
        else:
            self._read_on()

    def _read_ahead(self) -> None:
        """Act on a stop that waits behind other messages, and keep what comes up to a bound, to find one.

        Beyond the bound the socket is not read, which makes the client wait.
        """
        if self._connection.buffered > (_ROOM if self._allowance is None else _AHEAD):
            self._transport.pause_reading()
        else:
            self._read_on()
        if not self._searching and self._allowance is not None and self._connection.may_overtake:
            self._searching = True
            self._turns.later(self.identity, self._desk.privileged(self), self._search)

    def _search(self) -> None:
        """Search a few of the messages that wait for a stop, and act on it."""
        self._searching = False
        if self._closing or not self._overtaking.take(asyncio.get_running_loop().time()):
            return
        if (stop := self._connection.overtake()) is None:
            self._overtaking.spend(-1.0)
        else:
            self._guarded(self._hear, stop)
        self._read_ahead()

    def _end_of_stream(self) -> None:
        if not self._closing:
            for item in self._connection.receive_eof():
                self._guarded(self._hear, item)
        self._leave(self._overflow or "closed by the client")
        self._closing = True
        if self._lost:
            self._tell_closed()
        else:
            self._transport.close()
            self._abort_later()

    def _hear_some(self) -> tuple[float, bool]:
        """Hear a turn's worth of messages; return what they cost, and True if there may be more."""
        cost, self._bytes = self._bytes / _BYTES, 0
        limit, before = cost + _AT_ONCE, self._connection.buffered
        while cost < limit and before - self._connection.buffered < _BYTES:
            item = None if self._closing else self._connection.pop()
            if item is None:
                return cost, False
            cost += _COSTS.get(type(item), 1.0)
            self._guarded(self._hear, item)
        return cost, True

    def _hear(self, item: m.Message | Refusal) -> None:
        match item:
            case Refusal():
                self._refuse(item)
            case m.Hello():
                self._desk.hello(self, item)
            case m.Bye():
                self._leave(f"bye: {item.reason}" if item.reason else "bye")
                self.end(m.Bye())
            case _:
                self._desk.said(self, item)

    def _refuse(self, refusal: Refusal) -> None:
        if refusal.fatal:
            self._leave(f"{refusal.error.code}: {refusal.error.text}")
            self.end(refusal.error)
        else:
            self.say(refusal.error)

    def _write(self, frame: bytes) -> None:
        if self._holds:
            self._held.append(frame)
        elif not self._transport.is_closing():  # else it is lost, and asyncio is about to say so
            self._transport.write(frame)

    def _write_held(self) -> None:
        held, self._held = self._held, []
        if held and not self._transport.is_closing():
            self._transport.write(b"".join(held))

    def _close(self) -> None:
        """Close once everything is written and the client had time to read it."""
        if self._closing:
            return
        self._closing = True
        self._outbox.drop_states()  # nothing follows the last message
        self._read_on()  # to see when the client closes
        self._abort_later()
        self._write_eof()

    def _abort_later(self) -> None:
        """End the connection also if the client does not read what is left."""
        self.allow(None)
        self._timer = asyncio.get_running_loop().call_later(_LINGER, self._transport.abort)

    def _write_eof(self) -> None:
        # Closing with unread bytes of the client would make the kernel take back what was written last: say
        # that there is no more, and read on until the client closes. TLS does the same by its own means.
        self._write_held()
        if self._outbox.empty and not self._transport.is_closing():
            try:
                if self._transport.can_write_eof():
                    self._transport.write_eof()
                else:
                    self._transport.close()
            except OSError:  # the client has reset the connection meanwhile: its own affair
                self.abort()

    def _leave(self, reason: str) -> None:
        if not self._told_gone:
            self._told_gone = True
            self._guarded(self._desk.gone, self, reason)

    def _tell_closed(self) -> None:
        if not self._told_closed:
            self._told_closed = True
            self._guarded(self._desk.closed, self)

    def _guarded(self, function: Callable[..., None], *arguments: object) -> None:
        try:
            function(*arguments)
        except Exception as error:
            self._desk.failed(error)


def _address(guest: Slot, peername: object) -> str:
    """Return the address for the log; clients of the Unix socket choose their peer name freely."""
    match peername:
        case (host, port, *_) if guest.uid is None:
            return f"{host}:{port}"
        case _:
            return guest.origin
