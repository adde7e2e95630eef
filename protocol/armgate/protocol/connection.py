"""State machine of one connection, without I/O, for either side.

Theory of operation: one table, ``TRANSITIONS``, states which side may send which message in which state:
(state, sender, event) → next state. An event is the type of a message; a fatal error is the event ``fatal``.
All other messages are rejected. The table is the same for client and server. Each version of
the protocol has a table of its own: the same rules for the messages of its dialect.

Use::

    connection = Connection(Side.SERVER)
    for item in connection.receive(data):        # messages and refusals, in order
        if isinstance(item, Refusal):
            write(connection.send(item.error))   # (server) report it; close after a fatal error
        else: ...
    write(connection.send(message))
    connection.receive_eof()

``receive(data)`` is ``push(data)``, then ``pop()`` until it returns None. The daemon calls ``push`` when
bytes arrive and ``pop`` in the turns of the session. So messages may wait in the connection; their number of
bytes is ``buffered``, and the caller bounds it. Meanwhile ``overtake`` finds a ``stop`` among them.

A client does not send refusals: the protocol has no error message from client to server.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cache

from armgate.protocol import versions as v
from armgate.protocol.codec import MAX_ARRAY, MAX_ARRAY_INBOUND, decode, encode, unpack, valid
from armgate.protocol.errors import ErrorCode, LocalProtocolError, ProtocolError, RemoteProtocolError
from armgate.protocol.framing import (
    HANDSHAKE_LIMIT,
    INBOUND_LIMIT,
    OUTBOUND_LIMIT,
    FrameDecoder,
    FrameError,
)
from armgate.protocol.messages import Command, Error, Hello, Message, Request, Reset, Stop, Welcome


class Side(Enum):
    """Side of a connection."""

    CLIENT = "client"
    SERVER = "server"

    @property
    def other(self) -> "Side":
        """Side of the peer."""
        return Side.SERVER if self is Side.CLIENT else Side.CLIENT


class ConnectionState(Enum):
    """State of a connection."""

    AWAIT_HELLO = "await_hello"
    AWAIT_WELCOME = "await_welcome"
    READY = "ready"
    CLIENT_LEAVING = "client_leaving"
    """The client has sent ``bye``; the server's remaining messages are read until it closes."""
    SERVER_LEAVING = "server_leaving"
    """The server has sent ``bye``; messages that the client sent before may still arrive."""
    FAILED = "failed"
    """The peer's input was refused with a fatal error: nothing more is read, and this error may be sent."""
    CLOSED = "closed"


_STOP = b"stop"
_MAX_AHEAD = 128
"""Largest number of messages that one call of ``overtake`` inspects."""
_MAX_BYTES_AHEAD = 4096
"""Number of bytes after which one call of ``overtake`` inspects no further message."""

_OVERTAKEN = "a stop sent after this reset was handled first; reset the stops that the states list"

_State = ConnectionState
Key = tuple[ConnectionState, Side, str]


def _types(known: Iterable[str], *left_out: str) -> list[str]:
    return [name for name in known if name not in left_out]


@cache
def transitions(dialect: v.Dialect) -> dict[Key, ConnectionState]:
    """Return the table of one version: every allowed message with its next state."""
    client, server = Side.CLIENT, Side.SERVER
    from_client = _types(dialect.client, "hello", "bye")
    from_server = _types(dialect.server, "welcome", "bye")
    table: dict[Key, ConnectionState] = {
        (_State.AWAIT_HELLO, client, "hello"): _State.AWAIT_WELCOME,
        (_State.AWAIT_WELCOME, server, "welcome"): _State.READY,
        (_State.FAILED, client, "bye"): _State.CLOSED,
        (_State.FAILED, server, "fatal"): _State.CLOSED,
    }
    for state in (_State.AWAIT_HELLO, _State.AWAIT_WELCOME, _State.READY):
        table[state, client, "bye"] = _State.CLIENT_LEAVING
        table[state, server, "bye"] = _State.SERVER_LEAVING
        table[state, server, "fatal"] = _State.CLOSED
    for state in (_State.READY, _State.SERVER_LEAVING):
        table |= {(state, client, kind): state for kind in from_client}
    for state in (_State.READY, _State.CLIENT_LEAVING):
        table |= {(state, server, kind): state for kind in from_server}
    # The welcome may be on its way when a client that waits for it sends its bye.
    table[_State.CLIENT_LEAVING, server, "welcome"] = _State.CLIENT_LEAVING
    table[_State.CLIENT_LEAVING, server, "fatal"] = _State.CLOSED
    table[_State.CLIENT_LEAVING, server, "bye"] = _State.CLOSED
    table[_State.SERVER_LEAVING, client, "bye"] = _State.CLOSED
    return table


TRANSITIONS = transitions(v.DIALECTS[0])
"""Table of version 1."""


@cache
def _rules(dialect: v.Dialect, state: ConnectionState, side: Side) -> dict[str, ConnectionState]:
    """Return the part of the table for one state and sender: the next state by event."""
    table = transitions(dialect).items()
    return {event: following for (at, by, event), following in table if at is state and by is side}


@dataclass(frozen=True, slots=True)
class Refusal:
    """Refused input without effect; ``error`` is the message to send to the peer."""

    error: Error

    @property
    def fatal(self) -> bool:
        """True if nothing more is read from this connection."""
        return self.error.fatal


class Connection:
    """Protocol state of one stream of bytes.

    Attributes:
        role: This side of the connection.
        versions: Versions that this side supports.
        state: Current state; only the connection changes it.
        version: Version in use; None until it is chosen (server: by hello, client: by welcome).
        hello: The hello sent or received; None before.
        capabilities: Capabilities in the peer's hello or welcome.

    Args:
        role: This side of the connection.
        dialects: Supported versions, ascending.
    """

    def __init__(self, role: Side, dialects: Sequence[v.Dialect] = v.DIALECTS) -> None:
        self.role = role
        self.state: ConnectionState
        self.versions = tuple(dialect.version for dialect in dialects)
        self.version: int | None = None
        self.hello: Hello | None = None
        self.capabilities: frozenset[str] = frozenset()
        self._dialects = {dialect.version: dialect for dialect in dialects}
        # Until a version is chosen, only messages occur that are the same in all versions.
        self._dialect = dialects[-1]
        self._enter(ConnectionState.AWAIT_HELLO)
        server = role is Side.SERVER
        self._decoder = FrameDecoder(HANDSHAKE_LIMIT if server else OUTBOUND_LIMIT)
        self._max_array = MAX_ARRAY_INBOUND if server else MAX_ARRAY
        self._in_order = not server
        self._overtaken = 0  # number of frames not yet popped that a stop has overtaken

    def receive(self, data: bytes) -> list[Message | Refusal]:
        """Add bytes from the peer and return the messages and refusals that they complete, in order.

        After a fatal refusal, and after the close, later bytes are dropped. A server must send
        ``send(refusal.error)`` for each refusal, and close after a fatal one.
        """
        self.push(data)
        found = []
        while (item := self.pop()) is not None:
            found.append(item)
        return found

    def push(self, data: bytes) -> None:
        """Add bytes from the peer, even while messages wait; ``pop`` returns what they complete."""
        if not self._ignores_input:
            self._decoder.push(data)

    def pop(self) -> Message | Refusal | None:
        """Return the next message or refusal; None if no further one is complete."""
        if self._ignores_input:
            return None
        try:
            payload = self._decoder.pop()
            return None if payload is None else self._accept(payload)
        except FrameError as error:
            return self._refuse(_bad_frame(error))
        except ProtocolError as error:
            return self._refuse(error)

    @property
    def may_overtake(self) -> bool:
        """True if the messages that ``overtake`` has not inspected yet may contain a ``stop``."""
        return self.state is ConnectionState.READY and not self._in_order and self._decoder.may_hold(_STOP)

    def overtake(self) -> Stop | None:
        """Remove and return a complete ``stop`` that waits behind other messages; None if there is none.

        A stop behind a ``bye`` or behind malformed input stays where it is. ``pop`` refuses each ``reset``
        that the stop overtook: the client sent it before the stop, so it must not lift the stop. Each call
        inspects a bounded number of messages and bytes, and no message twice.
        """
        if not self.may_overtake:
            return None
        inspected = 0
        for _ in range(_MAX_AHEAD):
            payload = self._decoder.look_ahead()
            if payload is None:
                return None
            inspected += len(payload)
            message = self._read_ahead(payload)
            if message is not None:
                self._decoder.take_seen(len(payload))
                self._overtaken = self._decoder.ahead
                return message
            if self._in_order or inspected >= _MAX_BYTES_AHEAD:
                return None
        return None

    def _read_ahead(self, payload: bytes) -> Stop | None:
        """Return the stop in a payload; record whether messages behind this payload must keep their order."""
        try:
            fields = unpack(payload, self._max_array)
            kind = fields.get("type")
            self._in_order = kind in ("bye", "hello")
            model = self._dialect.client.get("stop") if kind == "stop" else None
            message = None if model is None else valid(model, fields)
            return message if isinstance(message, Stop) else None
        except ProtocolError:
            self._in_order = True
            return None

    def receive_eof(self) -> list[Message | Refusal]:
        """Close the connection at the end of the peer's stream; return a refusal for an incomplete frame."""
        cut = self._decoder.buffered and not self._ignores_input
        self._enter(ConnectionState.CLOSED)
        if not cut:
            return []
        text = f"the stream ended after {self._decoder.buffered} bytes of a frame"
        return [Refusal(RemoteProtocolError(ErrorCode.TRUNCATED, text).message())]

    def send(self, message: Message, frame: bytes | None = None) -> bytes:
        """Return the bytes of ``message``, to be written in order; empty if this version lacks the message.

        Args:
            message: Message to send.
            frame: Frame of the message, if it is encoded already (one state for many observers); used unless
                this version encodes the message differently.

        Raises:
            LocalProtocolError: The message is not allowed now, or cannot be encoded within the limit; the
                state of the connection is unchanged.
        """
        outward = self._dialect.outward
        translated = message if outward is None else outward(message)
        if translated is None:
            return b""
        following = self._may_send.get(_event(translated))
        if following is None:
            text = f"{message.type}: the {self.role.value} may not send this in state {self.state.value}"
            raise LocalProtocolError(ErrorCode.UNEXPECTED, text, about=message.type)
        if frame is None or translated is not message:
            frame = encode(translated, self._outgoing_limit)
        self._advance(translated, following)
        return frame

    @property
    def buffered(self) -> int:
        """Number of bytes pushed and not yet popped: complete frames that wait, and an incomplete one."""
        return self._decoder.buffered

    @property
    def limit(self) -> int:
        """Longest payload accepted now."""
        return self._decoder.limit

    @property
    def closed(self) -> bool:
        """True if nothing more can be sent or received."""
        return self.state is ConnectionState.CLOSED

    def _enter(self, state: ConnectionState) -> None:
        """Change the state, or the dialect within it; look up its rules once, not for every message."""
        self.state = state
        self._ignores_input = state in (ConnectionState.FAILED, ConnectionState.CLOSED)
        self._may_send = _rules(self._dialect, state, self.role)
        self._may_receive = _rules(self._dialect, state, self.role.other)

    @property
    def _outgoing_limit(self) -> int:
        if self.role is Side.SERVER:
            return OUTBOUND_LIMIT
        return HANDSHAKE_LIMIT if self.state is ConnectionState.AWAIT_HELLO else INBOUND_LIMIT

    def _accept(self, payload: bytes) -> Message:
        overtaken = self._overtaken > 0
        if overtaken:
            self._overtaken -= 1
        dialect = self._dialect
        known = dialect.client if self.role is Side.SERVER else dialect.server
        message = decode(payload, known, self._max_array)
        try:
            following = self._may_receive.get(_event(message))
            if following is None:
                text = f"{message.type}: not allowed from the {self.role.other.value}"
                text += f" in state {self.state.value}"
                raise RemoteProtocolError(ErrorCode.UNEXPECTED, text, about=message.type)
            if overtaken and isinstance(message, Reset):
                raise RemoteProtocolError(ErrorCode.UNKNOWN_STOP, _OVERTAKEN, about=message.type)
            self._choose_version(message)
            accepted = message if dialect.inward is None else dialect.inward(message)
        except RemoteProtocolError as error:
            raise _identified(error, message) from None
        self._advance(message, following)
        return accepted

    def _choose_version(self, message: Message) -> None:
        if isinstance(message, Hello):
            self._use(v.choose(self.versions, message.versions), message.capabilities)
        elif isinstance(message, Welcome):
            v.check_choice(message.version, message.versions, message.client_versions, self.versions)
            self._use(message.version, message.capabilities)

    def _use(self, version: int, capabilities: Iterable[str]) -> None:
        self.version, self._dialect = version, self._dialects[version]
        self._enter(self.state)
        self.capabilities = frozenset(capabilities)

    def _advance(self, message: Message, following: ConnectionState) -> None:
        if isinstance(message, Hello):
            self.hello = message
        elif isinstance(message, Welcome) and self.role is Side.SERVER:
            self._decoder.limit = INBOUND_LIMIT
        if following is not self.state:
            self._enter(following)

    def _refuse(self, error: ProtocolError) -> Refusal:
        # Before the welcome every error is fatal: otherwise the peers could disagree about the state.
        if self.state in (ConnectionState.AWAIT_HELLO, ConnectionState.AWAIT_WELCOME):
            error.fatal = True
        if error.fatal:
            self._enter(ConnectionState.FAILED)
        return Refusal(error.message())


def _bad_frame(error: FrameError) -> RemoteProtocolError:
    code = ErrorCode.FRAME_TOO_LARGE if error.length else ErrorCode.EMPTY_FRAME
    return RemoteProtocolError(code, str(error))


def _identified(error: RemoteProtocolError, message: Message) -> RemoteProtocolError:
    """Return the error with the id or number by which the peer finds the message."""
    if isinstance(message, Request):
        error.re = message.id
    elif isinstance(message, Command):
        error.seq = message.seq
    return error


def _event(message: Message) -> str:
    return "fatal" if type(message) is Error and message.fatal else message.type
