"""Generator of the vectors: JSON files with bytes in hexadecimal digits."""

import json
import math
from collections.abc import Callable, Iterable
from typing import Any

import msgpack

from armgate.protocol import encode
from armgate.protocol.framing import HEADER
from armgate.protocol.versions import DIALECTS
from tools.spec.examples import messages
from tools.spec.invalid import faults
from tools.spec.readable import readable as readable_payloads
from tools.spec.streams import STREAMS

_SIDES = {"client": DIALECTS[0].client, "server": DIALECTS[0].server}


def valid() -> str:
    """Return the messages whose bytes are read and written."""
    return _lines(_both_ways(side, name, value) for side, name, value in messages())


def readable() -> str:
    """Return the payloads in other encodings, or with keys to be ignored."""
    return _lines(
        {"name": name, "statements": list(ids), "from": "client", "hex": data.hex(), "value": to_json(value)}
        for name, ids, data, value in readable_payloads()
    )


def invalid() -> str:
    """Return the payloads that are refused, with their errors."""
    return _lines(
        {
            "name": fault.name,
            "statements": list(fault.statements),
            "from": fault.side,
            "state": fault.state,
            "hex": fault.payload.hex(),
            "error": {"code": fault.code, "fatal": fault.fatal, **fault.more},
        }
        for fault in faults()
    )


def streams() -> str:
    """Return the streams in pieces, with their events."""
    return _lines(
        {
            "name": name,
            "statements": list(ids),
            "pieces": [{"hex": data.hex(), "times": times} for data, times in pieces],
            "events": [e if isinstance(e, str) else {"code": e[0], "fatal": e[1]} for e in events],
        }
        for name, ids, pieces, events in STREAMS
    )


FILES: dict[str, Callable[[], str]] = {
    "messages.json": valid,
    "readable.json": readable,
    "invalid.json": invalid,
    "streams.json": streams,
}


def _both_ways(side: str, name: str, value: dict[str, Any]) -> dict[str, Any]:
    payload = _payload(side, value)
    decoded = to_json(msgpack.unpackb(payload))  # with keys in the order of the bytes
    if decoded != to_json(value):
        raise ValueError(f"{name}: encoded as {decoded}")
    return {"name": name, "from": side, "value": decoded, "hex": payload.hex()}


def _payload(side: str, value: dict[str, Any]) -> bytes:
    model = _SIDES[side][value["type"]]
    fields = msgpack.unpackb(msgpack.packb(value), use_list=False)
    return encode(model.model_validate(fields))[HEADER:]


def _lines(vectors: Iterable[dict[str, Any]]) -> str:
    """Return a JSON array with one vector per line, so that a diff shows only the changed vectors."""
    lines = [json.dumps(vector, ensure_ascii=False, allow_nan=False) for vector in vectors]
    return "[\n" + ",\n".join(lines) + "\n]\n"


# --- values in JSON ---------------------------------------------------------------------------------------

_EXACT = 2**53


def to_json(value: Any) -> Any:
    """Return a decoded payload in JSON's types; a map with one ``$`` key represents any other value."""
    match value:
        case bytes():
            return {"$hex": value.hex()}
        case float() if not math.isfinite(value):
            return {"$float": repr(value)}
        case int() if abs(value) > _EXACT:
            return {"$int": str(value)}
        case dict():
            return {key: to_json(item) for key, item in value.items()}
        case list() | tuple():
            return [to_json(item) for item in value]
    return value


def from_json(value: Any) -> Any:
    """Return the decoded payload of a JSON value."""
    match value:
        case {"$hex": text}:
            return bytes.fromhex(text)
        case {"$float": text}:
            return float(text)
        case {"$int": text}:
            return int(text)
        case dict():
            return {key: from_json(item) for key, item in value.items()}
        case list():
            return [from_json(item) for item in value]
    return value
