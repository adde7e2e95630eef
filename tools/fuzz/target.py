"""What must hold for any bytes: a message or a ProtocolError, however they are cut, in bounded memory.

The first byte of an input says what the rest is fed to, see ``ROLES``.
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
    """The bytes did what no bytes may."""


def check(data: bytes) -> None:
    """Feed an input.

    Raises:
        BrokenError: Something does not hold; any other exception than a ``ProtocolError`` is a defect too.
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
        _sayable(error.message())
        return
    written = encode(message)[HEADER:]
    again = encode(decode(written, catalogue, max_array))[HEADER:]
    _hold(written == again, "what was read and written again reads otherwise")


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
        _hold(whole == bytewise, "the cut of the stream shows")

    return fed


def _read(connection: Connection, pieces: Iterable[bytes]) -> str:
    """Everything that came of a stream, as text: NaN is equal to itself there."""
    found = []
    for piece in pieces:
        connection.push(piece)
        while (item := connection.pop()) is not None:
            found.append(repr(item))
            _answered(connection, item)
        if connection.buffered >= HEADER + connection.limit:  # at every byte: no call, no text
            raise BrokenError(f"{connection.buffered} bytes are kept")
    found += [repr(item) for item in connection.receive_eof()]
    _hold(connection.closed, "the stream has ended, the connection is open")
    return "\n".join(found)


def _answered(connection: Connection, item: m.Message | Refusal) -> None:
    """As a server does at once: answer hello, tell what was refused."""
    if isinstance(item, Refusal):
        _sayable(item.error)
        _hold(not item.fatal or connection.pop() is None, "something is read after a fatal fault")
    elif isinstance(item, m.Hello):
        connection.send(_WELCOME)


def _sayable(error: m.Error) -> None:
    decode(encode(error)[HEADER:], _DIALECT.server)
    _hold(len(error.text) <= 512, "the text of an error is too long")


def _hold(condition: bool, otherwise: str) -> None:
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
"""What reads the bytes: the decoder of either side, and its connection before and after the welcome."""
