"""Invariants for any bytes: a message or a ProtocolError, however the stream is divided, in bounded memory.

The first byte of an input selects the decoder for the rest, see ``ROLES``.
"""

from collections.abc import Callable, Iterable, Mapping

from armgate.protocol import DIALECTS, Connection, ProtocolError, Refusal, Side, decode, encode
from armgate.protocol import messages as m
from armgate.protocol.codec import MAX_ARRAY, MAX_ARRAY_INBOUND
from armgate.protocol.framing import HEADER

_LIMITS = m.Limits(inbound=1, outbound=1, max_age_ticks=3, lease_ttl=1.0, signals=1, signal_rate=1.0)
_HELLO = m.Hello(versions=(1,), name="c")
_WELCOME = m.Welcome(
    version=1, versions=(1,), client_versions=(1,), start="a", session="b", name="c", role="observer",
    limits=_LIMITS,
)  # fmt: skip
_DIALECT = DIALECTS[0]


class BrokenError(AssertionError):
    """Violated invariant."""


def check(data: bytes) -> None:
    """Check the invariants for an input.

    Raises:
        BrokenError: An invariant is violated. Any other exception except a ``ProtocolError`` is a defect too.
    """
    if data:
        role = ROLES[data[0] % len(ROLES)]
        role(data[1:])


# --- payloads ---------------------------------------------------------------------------------------------


def _from_client(payload: bytes) -> None:
    _decoded(payload, _DIALECT.client, MAX_ARRAY_INBOUND)


def _from_server(payload: bytes) -> None:
    _decoded(payload, _DIALECT.server, MAX_ARRAY)


def _decoded(payload: bytes, catalogue: Mapping[str, type[m.Message]], max_array: int) -> None:
    try:
        message = decode(payload, catalogue, max_array)
    except ProtocolError as error:
        _check_error(error.message())
        return
    written = encode(message)[HEADER:]
    again = encode(decode(written, catalogue, max_array))[HEADER:]
    _require(written == again, "a message changes in a round trip")


# --- streams ----------------------------------------------------------------------------------------------


def _fresh_server() -> Connection:
    return Connection(Side.SERVER)


def _ready_server() -> Connection:
    made = Connection(Side.SERVER)
    made.receive(encode(_HELLO))
    made.send(_WELCOME)
    return made


def _waiting_client() -> Connection:
    made = Connection(Side.CLIENT)
    made.send(_HELLO)
    return made


def _ready_client() -> Connection:
    made = _waiting_client()
    made.receive(encode(_WELCOME))
    return made


def _stream(make: Callable[[], Connection]) -> Callable[[bytes], None]:
    def fed(stream: bytes) -> None:
        whole = _read(make(), [stream])
        bytewise = _read(make(), (stream[i : i + 1] for i in range(len(stream))))
        _require(whole == bytewise, "the result depends on how the stream is divided")

    return fed


def _read(connection: Connection, pieces: Iterable[bytes]) -> str:
    """Return all items read from a stream, as a text, in which NaN equals itself."""
    found = []
    for piece in pieces:
        connection.push(piece)
        while (item := connection.pop()) is not None:
            found.append(repr(item))
            _react(connection, item)
        if (
            connection.buffered >= HEADER + connection.limit
        ):  # checked at every byte, so without a call or text
            raise BrokenError(f"{connection.buffered} bytes are buffered")
    found += [repr(item) for item in connection.receive_eof()]
    _require(connection.closed, "the connection is open after the end of the stream")
    return "\n".join(found)


def _react(connection: Connection, item: m.Message | Refusal) -> None:
    """React as a server does: answer hello, and send refusals."""
    if isinstance(item, Refusal):
        _check_error(item.error)
        _require(not item.fatal or connection.pop() is None, "a message is read after a fatal fault")
    elif isinstance(item, m.Hello):
        connection.send(_WELCOME)


def _check_error(error: m.Error) -> None:
    decode(encode(error)[HEADER:], _DIALECT.server)
    _require(len(error.text) <= 512, "the text of an error is too long")


def _require(condition: bool, otherwise: str) -> None:
    if not condition:
        raise BrokenError(otherwise)


ROLES: tuple[Callable[[bytes], None], ...] = (
    _from_client,
    _from_server,
    _stream(_fresh_server),
    _stream(_ready_server),
    _stream(_waiting_client),
    _stream(_ready_client),
)
"""Decoders of the bytes: that of either side, and its connection before and after the welcome."""
