"""Frames and msgpack, encoded and decoded by the kit itself.

It shares no code with the server, because an error in shared code would go undetected.
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


class Malformed(Exception):  # noqa: N818 (an error of the server, not of the kit)
    """The server sent bytes that the specification does not allow."""


def frame(payload: bytes) -> bytes:
    """Return a payload preceded by its length."""
    return struct.pack(">I", len(payload)) + payload


def pack(fields: Fields) -> bytes:
    """Return the frame of a message."""
    return frame(msgpack.packb(fields))


class FrameReader:
    """Decoder of frames: splits the server's bytes into payloads."""

    def __init__(self) -> None:
        self._buffer = bytearray()

    @property
    def pending(self) -> int:
        """Number of bytes of an incomplete frame."""
        return len(self._buffer)

    def feed(self, data: bytes) -> list[bytes]:
        """Return all payloads that are complete with these bytes.

        Raises:
            Malformed: A length is 0 or exceeds the limit of messages to clients.
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
    """Return the map in a payload.

    Raises:
        Malformed: The payload is not one map with text keys, or exceeds a limit.
    """
    try:
        value = msgpack.unpackb(payload, raw=False, strict_map_key=True, object_pairs_hook=_unique)
    except Exception as error:  # (any exception of msgpack here is caused by the server's bytes)
        raise Malformed(f"a payload from the server cannot be decoded: {error!r}") from None
    if not isinstance(value, dict):
        raise Malformed(f"a payload from the server is {type(value).__name__}, not a map")
    _check_limits(value, DEPTH)
    return value


def _unique(pairs: list[tuple[Any, Any]]) -> Fields:
    found = dict(pairs)
    if len(found) != len(pairs):
        raise ValueError("a key occurs twice in one map")
    return found


def _check_limits(value: Any, levels: int) -> None:
    match value:
        case dict() | list():
            limit, kind = (MAP, "map") if isinstance(value, dict) else (ARRAY, "array")
            if len(value) > limit or not levels:
                raise Malformed(
                    f"the server sent a {kind} of {len(value)} items, or nested deeper than {DEPTH} levels"
                )
            for item in value.values() if isinstance(value, dict) else value:
                _check_limits(item, levels - 1)
        case str() if len(value.encode()) > TEXT:
            raise Malformed(f"the server sent a text of {len(value.encode())} bytes; {TEXT} are allowed")
        case bytes() if len(value) > BINARY:
            raise Malformed(f"the server sent {len(value)} bytes of binary data; {BINARY} are allowed")
        case msgpack.ExtType() | msgpack.Timestamp():
            raise Malformed("the server sent an extension type")
        case float() if not math.isfinite(value):
            raise Malformed(f"the server sent the number {value}")
