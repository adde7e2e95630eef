"""Frames and msgpack as the kit itself reads and writes them.

Nothing here is the server's code: a mistake that both shared would hide itself.
"""

import math
import struct
from typing import Any

import msgpack

HEADER = 4
OUTBOUND_LIMIT = 1024 * 1024
DEPTH = 8
MAP = 128
ARRAY = 4096
TEXT = 4096
BINARY = 256 * 1024

Fields = dict[str, Any]


class Malformed(Exception):  # noqa: N818 (says what the server sent)
    """The server sent what the specification does not allow on the wire."""


def frame(payload: bytes) -> bytes:
    """A payload behind its length."""
    return struct.pack(">I", len(payload)) + payload


def pack(fields: Fields) -> bytes:
    """The frame of a message."""
    return frame(msgpack.packb(fields))


class Cutter:
    """Cuts what the server sends into payloads."""

    def __init__(self) -> None:
        self._buffer = bytearray()

    @property
    def left(self) -> int:
        """Bytes of a frame that is not complete."""
        return len(self._buffer)

    def feed(self, data: bytes) -> list[bytes]:
        """All payloads complete by now.

        Raises:
            Malformed: A length is 0 or beyond the limit towards clients.
        """
        self._buffer += data
        found = []
        while len(self._buffer) >= HEADER:
            (length,) = struct.unpack_from(">I", self._buffer)
            if not 0 < length <= OUTBOUND_LIMIT:
                raise Malformed(
                    f"a frame of {length} bytes from the server; 1 to {OUTBOUND_LIMIT} are allowed"
                )
            if len(self._buffer) < HEADER + length:
                break
            found.append(bytes(self._buffer[HEADER : HEADER + length]))
            del self._buffer[: HEADER + length]
        return found


def unpack(payload: bytes) -> Fields:
    """The map in a payload.

    Raises:
        Malformed: It is not one map with text keys, or breaks a bound.
    """
    try:
        value = msgpack.unpackb(payload, raw=False, strict_map_key=True, object_pairs_hook=_unique)
    except Exception as error:  # (whatever msgpack makes of it, it is the server's fault)
        raise Malformed(f"a payload from the server cannot be read: {error!r}") from None
    if not isinstance(value, dict):
        raise Malformed(f"a payload from the server is {type(value).__name__}, not a map")
    _bounded(value, DEPTH)
    return value


def _unique(pairs: list[tuple[Any, Any]]) -> Fields:
    found = dict(pairs)
    if len(found) != len(pairs):
        raise ValueError("a key stands twice in one map")
    return found


def _bounded(value: Any, deeper: int) -> None:
    match value:
        case dict() | list():
            limit, what = (MAP, "map") if isinstance(value, dict) else (ARRAY, "array")
            if len(value) > limit or not deeper:
                raise Malformed(
                    f"the server sent a {what} of {len(value)}, or one nested deeper than {DEPTH}"
                )
            for item in value.values() if isinstance(value, dict) else value:
                _bounded(item, deeper - 1)
        case str() if len(value.encode()) > TEXT:
            raise Malformed(f"the server sent a text of {len(value.encode())} bytes; {TEXT} are allowed")
        case bytes() if len(value) > BINARY:
            raise Malformed(f"the server sent {len(value)} bytes of binary data; {BINARY} are allowed")
        case msgpack.ExtType() | msgpack.Timestamp():
            raise Malformed("the server sent an extension type")
        case float() if not math.isfinite(value):
            raise Malformed(f"the server sent the number {value}")
