"""Session: the connection of one client, from its first byte to its end.

`SessionReader`, the base class, reads the messages of the client and passes them on.
"""

import asyncio
from collections.abc import Sequence

from armgate.daemon.auth.tls import peer_certificate
from armgate.daemon.sessions.connection_limits import Slot
from armgate.daemon.sessions.ending import Ending
from armgate.daemon.sessions.listener import ConnectionProtocol
from armgate.daemon.sessions.peer_socket import ReachabilityWatch, peer_socket
from armgate.daemon.sessions.rate_limits import RateLimit
from armgate.daemon.sessions.reading import SessionHost, SessionReader
from armgate.daemon.sessions.scheduler import FairScheduler, Work
from armgate.daemon.sessions.writing import Overflow, Writer
from armgate.protocol import (
    DIALECTS,
    Connection,
    ConnectionState,
    Dialect,
    ErrorCode,
    LocalProtocolError,
    RemoteProtocolError,
    Side,
)
from armgate.protocol import messages as m
from armgate.world.interfaces import Batch, Client, Encoded, RequestHandler

_LINGER = 1.0
"""Time that a client has to read the last message, s."""

_DELAYABLE = (m.Signaled, m.Verdict)
"""Types of messages that a batch may hold back, as it does states; all others are written at once."""

_EVICTED = "no hello came while other clients waited for the place; send hello right after connecting"


class Session(SessionReader, ConnectionProtocol):
    """Connection and, after its hello, its client; a `Peer` of the core.

    Args:
        host: The object to report to.
        number: Number of the connection, for the log.
        slot: Address of the client, and whether it may stay.
        send_buffer: Bytes of answers and verdicts that may wait for this client.
        scheduler: Gives the turns in which the client is read.
        limit: Bounds the rate at which it is read; None: no bound.
        dialects: Versions of the protocol that the daemon supports.
    """

    def __init__(
        self,
        host: SessionHost,
        number: int,
        slot: Slot,
        send_buffer: int,
        scheduler: FairScheduler,
        *,
        limit: RateLimit | None = None,
        dialects: Sequence[Dialect] = DIALECTS,
    ) -> None:
        super().__init__(host, slot, Connection(Side.SERVER, dialects), scheduler, limit)
        self.number = number
        self._writer = Writer(send_buffer)
        self._ending = Ending(self._report_left, self._report_closed)
        self._watch: ReachabilityWatch | None = None
        self._client: Client | None = None
        self._lost = False

    @property
    def client(self) -> Client:
        """The client; only after its hello."""
        assert self._client is not None, "no hello yet"
        return self._client

    @property
    def greeted(self) -> bool:
        """True if the client has been welcomed."""
        return self._client is not None

    @property
    def identity(self) -> str:
        """Token of the client, or its address if it has none; rate limits and turns count by identity."""
        return self.slot.origin if self._client is None else self._client.identity

    @property
    def version(self) -> int | None:
        """Version of the protocol that is spoken; None before the hello."""
        return self._connection.version

    @property
    def capabilities(self) -> frozenset[str]:
        """Capabilities that the client named in its hello."""
        return self._connection.capabilities

    @property
    def address(self) -> str:
        """Address of the client for the log; a client of the Unix socket chooses its peer name freely."""
        match self._transport.get_extra_info("peername"):
            case (host, port, *_) if self.slot.uid is None:
                return f"{host}:{port}"
            case _:
                return self.slot.origin

    @property
    def certificate(self) -> bytes | None:
        """The client's certificate in DER; None without one."""
        return peer_certificate(self._transport)

    @property
    def unread(self) -> int:
        """Bytes that wait here because the client reads slowly."""
        return self._writer.size

    @property
    def closing(self) -> bool:
        """True if nothing more is received or sent."""
        return self._ending.closing

    @property
    def privileged(self) -> bool:
        """True if the session is served before all others."""
        return self._host.privileged(self)

    # --- asyncio ------------------------------------------------------------------------------------------

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Register a new connection."""
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        # Data wait in the writer, not in the transport. With high=0, TLS would pause at once and for ever.
        transport.set_write_buffer_limits(high=1, low=0)
        try:
            kernel = peer_socket(transport.get_extra_info("socket"))
        except OSError:  # the connection is lost already
            self.abort()
            return
        self._writer.connect(transport, kernel)
        self._watch = ReachabilityWatch(kernel, self._unreachable)
        self._guarded(self._host.opened, self)

    def connection_lost(self, exc: Exception | None) -> None:
        """Process the loss of the connection, once all messages before the end have been read."""
        self._ending.clear_deadline()
        self._writer.close()
        if self._watch is not None:
            self._watch.cancel()
        self._lost = True
        if exc is None and self._reading_to_end and not self.closing:
            return
        self._ending.begin()
        self._cancel_reading()
        self._ending.leave("connection lost" if exc is None else str(exc))
        self._ending.finish()

    def pause_writing(self) -> None:
        """Queue all messages: the kernel accepts no more data."""
        self._writer.pause()

    def resume_writing(self) -> None:
        """Write the queue: the kernel accepts data again."""
        self._writer.resume()

    # --- for the host -------------------------------------------------------------------------------------

    def identify(self, client: Client, requests: RequestHandler) -> None:
        """Accept the hello of a client; ``requests`` handles its requests from now on."""
        self._client, self._handler = client, requests
        if self._limit is not None:
            self._limit.identify(client.identity)

    def _greet(self, hello: m.Hello) -> None:
        self._host.hello(self, hello)

    def forget(self) -> None:
        """Revoke the acceptance of the hello: the client cannot join."""
        self._client = None

    def allow(self, seconds: float, error: RemoteProtocolError) -> None:
        """Close the connection with an error unless `stay` is called within some seconds."""
        self._ending.set_deadline(seconds, lambda: self.close(error.message()))

    def stay(self) -> None:
        """Keep the connection: the hello came in time."""
        self._ending.clear_deadline()

    def serve(self, work: Work) -> None:
        """Do work of this connection in its turn."""
        self._scheduler.run_now(self.identity, self.privileged, work)

    def evict(self) -> None:
        """Close the connection to make room for another one: no hello came."""
        self.close(RemoteProtocolError(ErrorCode.HANDSHAKE_TIMEOUT, _EVICTED).message())

    # --- sending ------------------------------------------------------------------------------------------

    def send(self, message: m.Message, frame: bytes | None = None) -> None:
        """Send a message that may not be dropped; abort the connection if too many of them wait."""
        if self.closing:
            return
        try:
            encoded = self._connection.send(message, frame)
            self._writer.send(encoded, delayable=isinstance(message, _DELAYABLE))
        except LocalProtocolError:
            # After a bye or a violation of the protocol, or before a hello, nothing may be sent to a client.
            # Anything else is a defect.
            if self.greeted and self._connection.state is ConnectionState.READY:
                raise
        except Overflow as error:
            self._overflow(error)

    def send_states(self, *states: Encoded) -> None:
        """Send states; each replaces an older one of the same robot that still waits; see `keep_states`."""
        if self.closing:
            return
        frames = {state.state.robot: self._connection.send(state.state, state.frame) for state in states}
        try:
            self._writer.send_states(frames)
        except Overflow as error:
            self._overflow(error)

    def keep_states(self) -> None:
        """Send every state from now on; abort the connection if too many of them wait."""
        self._writer.keep_states()

    def drop_states(self) -> None:
        """Drop the states that wait: they belong to a subscription that has ended."""
        self._writer.drop_states()

    def batch(self) -> Batch:
        """Hold back states, and messages that may be delayed, until the batch closes."""
        return self._writer.batch()

    # --- the end ------------------------------------------------------------------------------------------

    def close(self, message: m.Message) -> None:
        """Send a last message, and close once the client had time to read it."""
        self.send(message)
        if self._ending.begin():
            self._read_on()  # to notice when the client closes
            self._ending.set_deadline(_LINGER, self._transport.abort)
            self._writer.finish()

    def expel(self, error: RemoteProtocolError) -> None:
        """Close with an error, and end the leases at once, even if the client does not read the error."""
        self.close(error.message())
        self._ending.leave(f"{error.code}: {error.text}")

    def abort(self) -> None:
        """Close at once; unsent data are lost."""
        self._abort_because("")

    def leave(self, reason: str) -> None:
        """Report that the session has left, unless that was reported before."""
        self._ending.leave(reason)

    def finish_stream(self) -> None:
        """Process the end of the client's stream; all messages before it have been received."""
        self._ending.leave("closed by the client")
        self._ending.begin()
        if self._lost:
            self._ending.finish()
        else:
            self._transport.close()
            self._ending.set_deadline(_LINGER, self._transport.abort)

    def _overflow(self, error: Overflow) -> None:
        # The end is reported in the next turn of the event loop: the core may be sending to many sessions.
        self._abort_because(f"{ErrorCode.OVERFLOW}: {error}")

    def _abort_because(self, reason: str) -> None:
        self._ending.begin(reason)
        self._transport.abort()

    def _unreachable(self) -> None:
        self._abort_because(f"no answer from {self.address}")

    def _report_left(self, reason: str) -> None:
        self._guarded(self._host.left, self, reason)

    def _report_closed(self) -> None:
        self._guarded(self._host.closed, self)
