"""Values of the vectors in JSON: what JSON cannot say is a map with one key that begins with ``$``."""

import math
from typing import Any

_EXACT = 2**53


def to_json(value: Any) -> Any:
    """A decoded payload as JSON holds it."""
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
    """The same, back."""
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
