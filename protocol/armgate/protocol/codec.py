"""Codec of messages.

``encode(message) -> frame`` and ``decode(payload, catalogue) -> message``; ``unpack`` is only the bounded
msgpack reader. ``encode`` writes ``type`` and the fields that were set, including those set to None, and
leaves out all others (see ``model_fields_set``). Therefore ``holder: nil`` in an entry (the robot is free)
differs from an absent ``holder`` (not subscribed).

Sizes are bounded on input: ``MAX_DEPTH`` of nesting, ``MAX_MAP`` keys, ``MAX_ARRAY`` items (server
to client) or ``MAX_ARRAY_INBOUND`` (client to server), ``MAX_STR`` bytes of text, ``MAX_CHUNK`` bytes of
binary data.
"""

from collections.abc import Mapping
from typing import Any

import msgpack
from pydantic import ValidationError

from armgate.protocol.errors import ErrorCode, LocalProtocolError, RemoteProtocolError, as_name
from armgate.protocol.fault_location import Bounds, expected_form, fault_in, offset_of
from armgate.protocol.framing import HEADER, OUTBOUND_LIMIT, frame
from armgate.protocol.messages import MAX_BODIES, MAX_CHUNK, Message, Part

MAX_DEPTH = 8
MAX_MAP = 128
MAX_ARRAY = MAX_BODIES
MAX_ARRAY_INBOUND = 256
MAX_STR = 4096
_SHOWN = 40
_MAP16 = 0xDE
_CONTAINERS = frozenset((tuple, dict))
_SECRET = "token"  # noqa: S105 (the name of the field)
_TYPE: bytes = msgpack.packb("type")


def encode(message: Message, limit: int = OUTBOUND_LIMIT) -> bytes:
    """Return the frame of ``message``.

    Raises:
        LocalProtocolError: A value cannot be encoded, or the payload is longer than ``limit``.
    """
    about = message.type
    try:
        payload: bytes = msgpack.packb({"type": about, **_set_fields(message)}, default=_part)
    except (TypeError, ValueError, OverflowError) as error:
        text = f"{about}: cannot be encoded: {error}"
        raise LocalProtocolError(ErrorCode.INVALID_MESSAGE, text, about=about) from error
    if len(payload) > limit:
        text = f"{about}: {len(payload)} bytes; the peer accepts at most {limit}"
        raise LocalProtocolError(ErrorCode.FRAME_TOO_LARGE, text, about=about)
    return frame(payload)


def _set_fields(model: Message | Part) -> dict[str, Any]:
    """Return the fields that were set, in the order of the model; faster than ``model_dump``."""
    fields, given = model.__dict__, model.model_fields_set
    return fields if len(fields) == len(given) else {name: fields[name] for name in fields if name in given}


def _part(value: object) -> dict[str, Any]:
    if not isinstance(value, Part):
        raise TypeError(f"{type(value).__name__} is not a value of a message")
    return _set_fields(value)


def with_re(frame_: bytes, re: int) -> bytes:
    """Add ``re`` to the frame of an answer that was encoded without it; the rest is not encoded again.

    The result is the frame that `encode` returns for the answer with ``re``, which follows the type.
    """
    payload = frame_[HEADER:]
    if payload[0] != _MAP16:
        count, body = payload[0] & 0x0F, payload[1:]
    else:
        count, body = int.from_bytes(payload[1:3], "big"), payload[3:]
    head = msgpack.Packer().pack_map_header(count + 1)
    end = len(_TYPE) + 1 + (body[len(_TYPE)] & 0x1F)  # names of types are shorter than 32 bytes
    return frame(head + body[:end] + msgpack.packb("re") + msgpack.packb(re) + body[end:])


def decode(payload: bytes, catalogue: Mapping[str, type[Message]], max_array: int = MAX_ARRAY) -> Message:
    """Return the message in ``payload``.

    Args:
        payload: Payload of a frame.
        catalogue: Models by ``type`` that the sender may use (``Catalogue.client`` or ``.server``).
        max_array: Longest accepted array.

    Raises:
        RemoteProtocolError: Fatal if the payload is not a well-formed map within the bounds; not fatal if the
            type is unknown or the fields are invalid.
    """
    fields = unpack(payload, max_array)
    kind = fields.get("type")
    if not isinstance(kind, str):
        text = f"type: expected a text, got {_shown(kind)}"
        raise RemoteProtocolError(ErrorCode.INVALID_MESSAGE, text, re=_count(fields.get("id"), 31))
    model = catalogue.get(kind)
    if model is None:
        known = ", ".join(catalogue)
        text = f"no message of type {_cut(kind)} here; known: {known}"
        raise RemoteProtocolError(
            ErrorCode.UNKNOWN_TYPE, text, about=as_name(kind), re=_count(fields.get("id"), 31)
        )
    try:
        return model.model_validate(fields)
    except ValidationError as error:
        raise _invalid(kind, fields, error, payload, max_array) from None


def valid(model: type[Message], fields: Mapping[str, Any]) -> Message | None:
    """Return the message with these fields; None if they are invalid."""
    try:
        return model.model_validate(fields)
    except ValidationError:
        return None


def unpack(payload: bytes, max_array: int = MAX_ARRAY) -> dict[str, Any]:
    """Return the map in ``payload``, with arrays as tuples.

    Raises:
        RemoteProtocolError: Fatal: the payload is not msgpack or not exactly one map, a bound is exceeded, a
            key is repeated or not a text, there is an extension type, or a text is not UTF-8.
    """
    try:
        value = msgpack.unpackb(
            payload,
            raw=False,
            use_list=False,
            strict_map_key=True,
            object_pairs_hook=_unique,
            ext_hook=_no_extension,
            max_str_len=MAX_STR,
            max_bin_len=MAX_CHUNK,
            max_array_len=max_array,
            max_map_len=MAX_MAP,
            max_ext_len=0,
        )
    except (ValueError, msgpack.UnpackException, RecursionError):
        value = None
    if not isinstance(value, dict) or _is_deep(value):
        raise _malformed(fault_in(payload, _bounds(max_array)))
    return value


def _malformed(text: str) -> RemoteProtocolError:
    return RemoteProtocolError(ErrorCode.MALFORMED, text)


def _bounds(max_array: int) -> Bounds:
    return Bounds(depth=MAX_DEPTH, map=MAX_MAP, array=max_array, text=MAX_STR, binary=MAX_CHUNK)


def _unique(pairs: list[tuple[Any, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        raise ValueError("a key occurs twice in one map")
    try:
        "".join(found)  # the fastest check of the types of all keys
    except TypeError:
        raise ValueError("a key is not a text") from None
    return found


def _no_extension(code: int, data: bytes) -> object:
    raise ValueError(f"extension type {code} is not accepted")


def _is_deep(value: dict[str, Any]) -> bool:
    # Breadth-first: most items are numbers, and one pass per level is the cheapest way to skip them.
    level: list[Any] = [value]
    for _ in range(MAX_DEPTH):
        level = [
            item
            for part in level
            for item in (part.values() if type(part) is dict else part)
            if type(item) in _CONTAINERS
        ]
        if not level:
            return False
    return True


def _invalid(
    kind: str, fields: dict[str, Any], error: ValidationError, payload: bytes, max_array: int
) -> RemoteProtocolError:
    problems = error.errors(include_url=False)
    first, path = problems[0], problems[0]["loc"]
    text = kind + "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in path)
    if first["type"] == "missing":
        text += ": is missing"
    else:
        given = first["input"]
        text += f": expected {expected_form(first['type'], first.get('ctx', {}))}"
        text += f"; got {_kind(given) if _SECRET in path else _shown(given)}"
        if (offset := offset_of(payload, path, _bounds(max_array))) is not None:
            text += f" at byte {offset}"
    if len(problems) > 1:
        text += f" (and {len(problems) - 1} more)"
    seq = _count(fields.get("seq"), 63) if kind == "command" else None
    return RemoteProtocolError(
        ErrorCode.INVALID_MESSAGE, text, about=kind, seq=seq, re=_count(fields.get("id"), 31)
    )


def _count(value: object, bits: int) -> int | None:
    return value if type(value) is int and 0 <= value < 2**bits else None


_KINDS = {
    bool: "a bool",
    int: "an integer",
    float: "a number",
    str: "a text",
    bytes: "binary data",
    tuple: "an array",
    dict: "a map",
}


def _kind(value: object) -> str:
    return "nil" if value is None else _KINDS.get(type(value), type(value).__name__)


def _shown(value: object) -> str:
    # Show scalars only: a map or an array may hold a secret.
    if value is None or isinstance(value, (tuple, dict, bytes)):
        return _kind(value)
    return f"{_kind(value)} {_cut(value)}"


def _cut(value: object) -> str:
    shown = repr(value)
    return shown if len(shown) <= _SHOWN else shown[:_SHOWN] + "…"
