"""Streams of bytes in pieces, written by hand, with the events that a server in state ``ready`` reads."""

import msgpack

Piece = tuple[bytes, int]
"""Bytes, and the number of repetitions."""

Event = str | tuple[str, bool]
"""Type of a message, or code of an error and True if it is fatal."""


def _framed(payload: bytes) -> bytes:
    return len(payload).to_bytes(4, "big") + payload


PING = _framed(msgpack.packb({"type": "ping", "time": 1.0}))
BYE = _framed(msgpack.packb({"type": "bye"}))
TEA = _framed(msgpack.packb({"type": "tea"}))
BROKEN = _framed(b"\xc1")
_HEAD = msgpack.packb({"type": "ping", "time": 1.0, "a": b""})[:-2]
FULL = 65536
_FILL = FULL - len(_HEAD) - 3
_LARGEST = FULL.to_bytes(4, "big") + _HEAD + b"\xc5" + _FILL.to_bytes(2, "big")

STREAMS: list[tuple[str, tuple[str, ...], list[Piece], list[Event]]] = [
    ("one frame in one piece", ("FRM-1",), [(PING, 1)], ["ping"]),
    ("two frames in one piece", ("FRM-2",), [(PING + PING, 1)], ["ping", "ping"]),
    ("100 frames in one piece", ("FRM-2",), [(PING, 100)], ["ping"] * 100),
    ("a frame byte by byte", ("FRM-2",), [(PING[i : i + 1], 1) for i in range(len(PING))], ["ping"]),
    ("a frame divided inside its length", ("FRM-2",), [(PING[:2], 1), (PING[2:], 1)], ["ping"]),
    ("a frame divided after its length", ("FRM-2",), [(PING[:4], 1), (PING[4:], 1)], ["ping"]),
    ("a frame and a half, then the rest", ("FRM-2",), [(PING + PING[:9], 1), (PING[9:], 1)], ["ping"] * 2),
    ("nothing", ("FRM-9",), [], []),
    ("an incomplete frame", ("FRM-9",), [(PING + PING[:-1], 1)], ["ping", ("truncated", True)]),
    ("an incomplete length", ("FRM-9",), [(PING[:3], 1)], [("truncated", True)]),
    ("a frame of the largest length", ("FRM-6",), [(_LARGEST, 1), (b"\0", _FILL)], ["ping"]),
    (
        "a length beyond the limit by 1",
        ("FRM-6", "FRM-7"),
        [(b"\x00\x01\x00\x01", 1)],
        [("frame_too_large", True)],
    ),
    ("the largest length", ("FRM-6", "FRM-7"), [(b"\xff\xff\xff\xff", 1)], [("frame_too_large", True)]),
    (
        "a length in little-endian order",
        ("FRM-1",),
        [(PING[3::-1] + PING[4:], 1)],
        [("frame_too_large", True)],
    ),
    ("text", ("FRM-6",), [(b"GET / HTTP/1.1\r\n", 1)], [("frame_too_large", True)]),
    ("length 0", ("FRM-8",), [(bytes(4), 1)], [("empty_frame", True)]),
    ("length 0 after a frame", ("FRM-8", "CON-8"), [(PING + bytes(4), 1)], ["ping", ("empty_frame", True)]),
    ("a frame after a fatal fault", ("CON-7",), [(PING + BROKEN + PING, 1)], ["ping", ("malformed", True)]),
    ("a frame after an unknown type", ("ERR-2",), [(TEA + PING, 1)], [("unknown_type", False), "ping"]),
    ("a frame after bye", ("CON-5",), [(BYE + PING, 1)], ["bye", ("unexpected", True)]),
]
