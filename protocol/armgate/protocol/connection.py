"""One connection's conversation, without I/O, for either side.

Who speaks when is one table, ``TRANSITIONS``: (state, sender, event) → state, where an event is a message's
type, and a fatal error counts as ``fatal``. The table does not know which side it runs on. Each version of
the protocol has its own: the same one, with the messages of its dialect.

Use, on both sides::

    connection = Connection(Side.SERVER)
    for item in connection.receive(data):        # messages and refusals, in order
        if isinstance(item, Refusal):
            write(connection.send(item.error))   # (server) tells the peer; close after a fatal one
        else: ...
    write(connection.send(message))
    connection.receive_eof()

On the client side a refusal is not sent: there is no error message from client to server.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cache

from armgate.protocol import versions as v
from armgate.protocol.codec import MAX_ARRAY, MAX_ARRAY_INBOUND, decode, encode, unpack, valid
from armgate.protocol.errors import ErrorCode, LocalProtocolError, ProtocolError, RemoteProtocolError
from armgate.protocol.framing import HANDSHAKE_LIMIT, INBOUND_LIMIT, OUTBOUND_LIMIT, FrameDecoder
from armgate.protocol.messages import Command, Error, Hello, Message, Request, Reset, Stop, Welcome


class Side(Enum):
    """Which end of the connection."""

    CLIENT = "client"
    SERVER = "server"

    @property
    def other(self) -> "Side":
        """The peer's side."""
        return Side.SERVER if self is Side.CLIENT else Side.CLIENT


class ConnectionState(Enum):
    """Where the conversation is."""

    AWAIT_HELLO = "await_hello"
    AWAIT_WELCOME = "await_welcome"
    READY = "ready"
    CLIENT_LEAVING = "client_leaving"
    """The client said bye; what the server still sends is read until it closes."""
    SERVER_LEAVING = "server_leaving"
    """The server said bye; what the client had already sent may still arrive."""
    FAILED = "failed"
    """A fatal fault was found in what the peer sent: nothing more is read, the fatal error may be sent."""
    CLOSED = "closed"


_STOP = b"stop"
_LOOKED_AT = 128
"""Messages that one call looks at in search of a stop."""
_BYTES_LOOKED_AT = 4096
"""Bytes after which one call looks at no further message."""

_OVERTAKEN = "a stop that was sent after this reset was acted on first; reset the stops that states name"

_State = ConnectionState
Key = tuple[ConnectionState, Side, str]


def _types(known: Iterable[str], *left_out: str) -> list[str]:
    return [name for name in known if name not in left_out]


@cache
def transitions(dialect: v.Dialect) -> dict[Key, ConnectionState]:
    """All that may be said in one version: what is not in here may not."""
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
    table[_State.CLIENT_LEAVING, server, "fatal"] = _State.CLOSED
    table[_State.CLIENT_LEAVING, server, "bye"] = _State.CLOSED
    table[_State.SERVER_LEAVING, client, "bye"] = _State.CLOSED
    return table


TRANSITIONS = transitions(v.DIALECTS[0])
"""The table of version 1."""


@dataclass(frozen=True, slots=True)
class Refusal:
    """Something that the peer sent and that is of no effect; ``error`` is what it is told."""

    error: Error

    @property
    def fatal(self) -> bool:
        """Whether nothing more is read from this connection."""
        return self.error.fatal


class Connection:
    """The conversation over one stream of bytes.

    Attributes:
        role: The side that this object plays.
        versions: The versions that this side speaks.
        state: Where the conversation is.
        version: The version spoken, None before it is known (server: hello, client: welcome).
        hello: The hello sent or received, None before.
        capabilities: What the peer has named in its hello or welcome.

    Args:
        role: The side to play.
        dialects: The versions to speak, ascending.
    """

    def __init__(self, role: Side, dialects: Sequence[v.Dialect] = v.DIALECTS) -> None:
        self.role = role
        self.versions = tuple(dialect.version for dialect in dialects)
        self.state = ConnectionState.AWAIT_HELLO
        self.version: int | None = None
        self.hello: Hello | None = None
        self.capabilities: frozenset[str] = frozenset()
        self._dialects = {dialect.version: dialect for dialect in dialects}
        # Before one is chosen only that is said which is the same in all of them.
        self._dialect = dialects[-1]
        server = role is Side.SERVER
        self._decoder = FrameDecoder(HANDSHAKE_LIMIT if server else OUTBOUND_LIMIT)
        self._max_array = MAX_ARRAY_INBOUND if server else MAX_ARRAY
        self._in_order = not server
        self._overtaken = 0  # frames still to be popped that a stop has overtaken

    def receive(self, data: bytes) -> list[Message | Refusal]:
        """Takes bytes from the peer and returns what they complete, in order.

        After a fatal refusal, and once closed, nothing more is read: later bytes are dropped. The caller
        owes the peer ``send(refusal.error)`` for each refusal (server side), and must close after a fatal
        one.
        """
        self.push(data)
        found = []
        while (item := self.pop()) is not None:
            found.append(item)
        return found

    def push(self, data: bytes) -> None:
        """Takes bytes from the peer, of which ``pop`` gives what they complete, one by one."""
        if not self._deaf:
            self._decoder.push(data)

    def pop(self) -> Message | Refusal | None:
        """The next of what the peer said; None: nothing more is complete."""
        if self._deaf:
            return None
        try:
            payload = self._decoder.pop()
            return None if payload is None else self._accept(payload)
        except ProtocolError as error:
            return self._refuse(error)

    @property
    def may_overtake(self) -> bool:
        """True if there may be a ``stop`` among the messages that `overtake` has not looked at yet."""
        return self.state is ConnectionState.READY and not self._in_order and self._decoder.may_hold(_STOP)

    def overtake(self) -> Stop | None:
        """Take a complete ``stop`` from behind other unread messages, ahead of its turn; None: there is none.

        Nothing is taken from behind a ``bye`` or a fatal fault. ``pop`` refuses each ``reset`` that the stop
        overtook: it was sent before the stop and must not lift it. Each call looks at a bounded number of
        messages and bytes, at none of them twice.
        """
        if not self.may_overtake:
            return None
        looked_at = 0
        for _ in range(_LOOKED_AT):
            payload = self._decoder.look_ahead()
            if payload is None:
                return None
            looked_at += len(payload)
            message = self._read_ahead(payload)
            if message is not None:
                self._decoder.take_seen(len(payload))
                self._overtaken = self._decoder.ahead
                return message
            if self._in_order or looked_at >= _BYTES_LOOKED_AT:
                return None
        return None

    def _read_ahead(self, payload: bytes) -> Stop | None:
        """Return the stop in a payload; note if nothing behind this payload may be taken ahead of it."""
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
        """The peer sends no more: the connection is closed; a frame that was cut off is a refusal."""
        cut = self._decoder.buffered and not self._deaf
        self.state = ConnectionState.CLOSED
        if not cut:
            return []
        text = f"the stream ended after {self._decoder.buffered} bytes of a frame"
        return [Refusal(RemoteProtocolError(ErrorCode.TRUNCATED, text).message())]

    def send(self, message: Message, frame: bytes | None = None) -> bytes:
        """The bytes of ``message``, to be written in this order; none if this version has no word for it.

        Args:
            message: What to say.
            frame: Its frame where it is known already (one state to many observers); it is not encoded again,
                unless this version says it otherwise.

        Raises:
            LocalProtocolError: It may not be said now, or has no form within the limit; nothing has changed.
        """
        said = self._dialect.outward(message)
        if said is None:
            return b""
        following = self._following(self.role, said)
        if following is None:
            text = f"{message.type}: the {self.role.value} may not send this in state {self.state.value}"
            raise LocalProtocolError(ErrorCode.UNEXPECTED, text, about=message.type)
        if frame is None or said is not message:
            frame = encode(said, self._outgoing_limit)
        self._note(said, following)
        return frame

    @property
    def buffered(self) -> int:
        """How many bytes of an unfinished frame are kept."""
        return self._decoder.buffered

    @property
    def limit(self) -> int:
        """The longest payload that is accepted now."""
        return self._decoder.limit

    @property
    def closed(self) -> bool:
        """Whether nothing more can be said or read."""
        return self.state is ConnectionState.CLOSED

    @property
    def _deaf(self) -> bool:
        return self.state in (ConnectionState.FAILED, ConnectionState.CLOSED)

    @property
    def _outgoing_limit(self) -> int:
        if self.role is Side.SERVER:
            return OUTBOUND_LIMIT
        return HANDSHAKE_LIMIT if self.state is ConnectionState.AWAIT_HELLO else INBOUND_LIMIT

    def _accept(self, payload: bytes) -> Message:
        overtaken, self._overtaken = self._overtaken > 0, max(0, self._overtaken - 1)
        dialect = self._dialect
        known = dialect.client if self.role is Side.SERVER else dialect.server
        message = decode(payload, known, self._max_array)
        try:
            following = self._following(self.role.other, message)
            if following is None:
                text = f"{message.type}: not allowed from the {self.role.other.value}"
                text += f" in state {self.state.value}"
                raise RemoteProtocolError(ErrorCode.UNEXPECTED, text, about=message.type)
            if overtaken and isinstance(message, Reset):
                raise RemoteProtocolError(ErrorCode.UNKNOWN_STOP, _OVERTAKEN, about=message.type)
            self._agree(message)
            inward = dialect.inward(message)
        except RemoteProtocolError as error:
            raise _about(error, message) from None
        self._note(message, following)
        return inward

    def _following(self, side: Side, message: Message) -> ConnectionState | None:
        return transitions(self._dialect).get((self.state, side, _event(message)))

    def _agree(self, message: Message) -> None:
        if isinstance(message, Hello):
            self._speak(v.choose(self.versions, message.versions), message.capabilities)
        elif isinstance(message, Welcome):
            v.check_choice(message.version, message.versions, message.client_versions, self.versions)
            self._speak(message.version, message.capabilities)

    def _speak(self, version: int, capabilities: Iterable[str]) -> None:
        self.version, self._dialect = version, self._dialects[version]
        self.capabilities = frozenset(capabilities)

    def _note(self, message: Message, following: ConnectionState) -> None:
        if isinstance(message, Hello):
            self.hello = message
        elif isinstance(message, Welcome) and self.role is Side.SERVER:
            self._decoder.limit = INBOUND_LIMIT
        self.state = following

    def _refuse(self, error: ProtocolError) -> Refusal:
        # Before the welcome nothing can be left out: the peers would disagree about where they are.
        if self.state in (ConnectionState.AWAIT_HELLO, ConnectionState.AWAIT_WELCOME):
            error.fatal = True
        if error.fatal:
            self.state = ConnectionState.FAILED
        return Refusal(error.message())


def _about(error: RemoteProtocolError, message: Message) -> RemoteProtocolError:
    """The error with what the peer needs to find the message again."""
    if isinstance(message, Request):
        error.re = message.id
    elif isinstance(message, Command):
        error.seq = message.seq
    return error


def _event(message: Message) -> str:
    return "fatal" if isinstance(message, Error) and message.fatal else message.type
