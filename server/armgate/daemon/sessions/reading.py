"""Reading of one client: in fair turns, within its rate limits, and stops ahead of other messages.

A client whose allowance is used up is not read for a while. Its messages are then kept up to a bound and
searched for a stop, which is executed at once. Beyond the bound its socket is not read, so the client waits;
none of its messages is dropped.
"""

import asyncio
from abc import abstractmethod
from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol

from armgate.daemon.sessions.connection_limits import Slot
from armgate.daemon.sessions.rate_limits import RateLimit
from armgate.daemon.sessions.scheduler import FairScheduler, Work
from armgate.protocol import Connection, Refusal
from armgate.protocol import messages as m
from armgate.world.interfaces import REQUESTS, Peer, RequestHandler
from armgate.world.token_bucket import TokenBucket

if TYPE_CHECKING:
    from armgate.daemon.sessions.session import Session

_BUFFER = 16 * 1024
"""Bytes that are read at once; asyncio's own buffer of 256 KiB is allocated again by the system each time."""

_DISCARD = 0.01
"""Time between two reads of a connection that is closing, s: data that a client still sends cost little."""

_AT_ONCE = 8
"""Largest number of messages of one client that are read before other clients have their turn."""

_BYTES = 2048
"""Bytes that count as one more message, and after which a turn of reading ends."""

_AHEAD = 256 * 1024
"""Number of bytes of a client that are kept and searched for a stop while it waits for its turn."""

_STOPS = 20.0
"""Stops of a client that are executed ahead of its other messages: rate per second, and burst."""

_COSTS: dict[type[object], float] = {
    Refusal: 2, m.Describe: 20, m.Asset: 20, m.Sessions: 20,
    m.Stop: 8, m.Reset: 8, m.Subscribe: 4, m.Acquire: 2, m.Release: 2,
}  # fmt: skip
"""Messages that count as more than one: the answer is large, goes to all clients, or takes long to write."""


class SessionHost(Protocol):
    """Receiver of the reports of sessions; called by `Session`."""

    @property
    def serving(self) -> bool:
        """True if requests of clients are processed."""

    def opened(self, session: "Session") -> None:
        """Process a new connection."""

    def hello(self, session: "Session", hello: m.Hello) -> None:
        """Process a hello: answer with welcome or a fatal error."""

    def left(self, session: "Session", reason: str) -> None:
        """Process the end of a session by a bye or the loss of its connection; called once."""

    def closed(self, session: "Session") -> None:
        """Process the end of a connection; nothing is called for it afterwards."""

    def privileged(self, session: "Session") -> bool:
        """Return True if the session is served first: it holds a robot, or is operator by token or user."""

    def failed(self, error: BaseException) -> None:
        """Process a defect of the daemon."""


class SessionReader(asyncio.BufferedProtocol, Peer):
    """Reading side of a session: asyncio's buffer, its messages in turns, and the handler of each.

    Args:
        host: The object to report to.
        slot: Address of the client, and whether it may stay.
        connection: Decodes its bytes.
        scheduler: Gives the turns in which the client is read.
        limit: Bounds the rate at which it is read; None: no bound.
    """

    def __init__(
        self,
        host: SessionHost,
        slot: Slot,
        connection: Connection,
        scheduler: FairScheduler,
        limit: RateLimit | None,
    ) -> None:
        self.slot = slot
        self._host = host
        self._connection = connection
        self._scheduler = scheduler
        self._limit = limit
        self._handler: RequestHandler
        self._transport: asyncio.Transport
        self._buffer = memoryview(bytearray(_BUFFER))
        self._bytes = 0
        self._stop_rate = TokenBucket(_STOPS, _STOPS, 0.0)
        self._reading = self._searching = self._ended = False
        self._timer: asyncio.TimerHandle | None = None

    # --- the session, see `Session` -----------------------------------------------------------------------

    @property
    @abstractmethod
    def identity(self) -> str:
        """Token of the client, or its address if it has none; rate limits and turns count by identity."""

    @property
    @abstractmethod
    def greeted(self) -> bool:
        """True if the client has been welcomed."""

    @property
    @abstractmethod
    def closing(self) -> bool:
        """True if nothing more is received or sent."""

    @property
    @abstractmethod
    def privileged(self) -> bool:
        """True if the session is served before all others."""

    @abstractmethod
    def _greet(self, hello: m.Hello) -> None:
        """Pass a hello to the host."""

    @abstractmethod
    def leave(self, reason: str) -> None:
        """Report that the session has left, unless that was reported before."""

    @abstractmethod
    def finish_stream(self) -> None:
        """Process the end of the client's stream; all messages before it have been received."""

    # --- asyncio ------------------------------------------------------------------------------------------

    def get_buffer(self, sizehint: int) -> memoryview:
        """Return the memory for incoming bytes."""
        return self._buffer

    def buffer_updated(self, nbytes: int) -> None:
        """Take the bytes that arrived in the buffer: read them at once if the scheduler permits, else later.

        While earlier messages wait, bytes are added up to `_AHEAD`, and only searched for a stop.
        """
        if self.closing:
            self._discard()
            return
        self.slot.note_data()
        self._connection.push(bytes(self._buffer[:nbytes]))
        self._bytes += nbytes
        if self._reading:
            self._read_ahead()
        else:
            self._reading = True
            self._request_turn(self._scheduler.run_now)

    def eof_received(self) -> bool:
        """Process the end of the client's stream, once all messages before it have been read.

        Returns:
            True if the transport must stay open until then; a transport of TLS cannot.
        """
        self._ended = True
        if not self._reading:
            self._end_stream()
        return self._reading and self._transport.can_write_eof()

    @property
    def _reading_to_end(self) -> bool:
        """True if the client's stream has ended, but messages before its end are still to be read."""
        return self._ended and self._reading

    def _discard(self) -> None:
        """Discard bytes of a connection that is closing, and read on only after a pause."""
        self._cancel_reading()
        if not self._transport.is_closing():
            self._transport.pause_reading()
            self._timer = asyncio.get_running_loop().call_later(_DISCARD, self._read_on)

    def _cancel_reading(self) -> None:
        if self._timer is not None:
            self._timer.cancel()

    def _read_on(self) -> None:
        """Read the socket again, unless the transport is closed: the transport of TLS would fail then."""
        if not self._transport.is_closing():
            self._transport.resume_reading()

    # --- turns --------------------------------------------------------------------------------------------

    def _request_turn(self, run: Callable[[str, bool, Work], None]) -> None:
        """Read when it is this session's turn and its rate limit permits it."""
        wait = 0.0 if self._limit is None else self._limit.reserve(self._own_limit_only)
        if wait:
            self._read_ahead()
            self._timer = asyncio.get_running_loop().call_later(wait, self._resume)
        else:
            run(self.identity, self.privileged, self._read)

    @property
    def _own_limit_only(self) -> bool:
        """True if only the connection's own limit counts: before the hello no client may delay another."""
        return self.privileged or not self.greeted

    def _resume(self) -> None:
        self._scheduler.run_now(self.identity, self.privileged, self._read)

    def _read(self) -> None:
        """Read as much as one turn allows, and request another turn for the rest."""
        limit = self._limit
        own_limit_only = limit is not None and self._own_limit_only
        with self.batch():
            cost, more = self._receive_some()
        if limit is not None:
            limit.spend(cost - 1.0, own_limit_only)
        if more:
            self._read_ahead()
            self._request_turn(self._scheduler.run_later)
            return
        self._reading = False
        if self._ended:
            self._end_stream()
        else:
            self._read_on()

    def _receive_some(self) -> tuple[float, bool]:
        """Receive the messages of one turn; return their cost, and True if there may be more."""
        cost, self._bytes = self._bytes / _BYTES, 0
        limit, before = cost + _AT_ONCE, self._connection.buffered
        while cost < limit and before - self._connection.buffered < _BYTES:
            item = None if self.closing else self._connection.pop()
            if item is None:
                return cost, False
            cost += _COSTS.get(type(item), 1.0)
            self.receive(item)
        return cost, True

    def _end_stream(self) -> None:
        if not self.closing:
            for item in self._connection.receive_eof():
                self.receive(item)
        self.finish_stream()

    # --- messages ------------------------------------------------------------------------------------------

    def receive(self, item: m.Message | Refusal) -> None:
        """Process a message, or bytes that are not a message; a defect is reported to the host."""
        self._guarded(self._process, item)

    def _process(self, item: m.Message | Refusal) -> None:
        match item:
            case Refusal():
                self._refuse(item)
            case m.Hello():
                self._greet(item)
            case m.Bye():
                self.leave(f"bye: {item.reason}" if item.reason else "bye")
                self.close(m.Bye())
            case _ if type(item) in REQUESTS:
                if self._host.serving:
                    self._handler.handle(self, item)  # type: ignore[arg-type]
            case _:
                raise AssertionError(f"{item.type}: not a message of clients")

    def _refuse(self, refusal: Refusal) -> None:
        if refusal.fatal:
            self.leave(f"{refusal.error.code}: {refusal.error.text}")
            self.close(refusal.error)
        else:
            self.send(refusal.error)

    def _guarded(self, function: Callable[..., None], *arguments: object) -> None:
        try:
            function(*arguments)
        except Exception as error:
            self._host.failed(error)

    # --- stops first --------------------------------------------------------------------------------------

    def _read_ahead(self) -> None:
        """Keep incoming messages, and execute a stop among them; pause reading when too many bytes wait."""
        if self._connection.buffered > (_BUFFER if self._limit is None else _AHEAD):
            self._transport.pause_reading()
        else:
            self._read_on()
        if not self._searching and self._limit is not None and self._connection.may_overtake:
            self._searching = True
            self._scheduler.run_later(self.identity, self.privileged, self._search)

    def _search(self) -> None:
        """Search a few of the waiting messages for a stop, and execute it."""
        self._searching = False
        if self.closing or not self._stop_rate.take(asyncio.get_running_loop().time()):
            return
        if (stop := self._connection.overtake()) is None:
            self._stop_rate.spend(-1.0)
        else:
            self.receive(stop)
        self._read_ahead()
