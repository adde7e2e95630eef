"""Location of a fault in a payload: a second, slow pass after the fast reader has refused the payload."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

MAX_VALUES = 128
"""Largest number of values in the second pass (about 0.1 ms); later faults are not located."""


@dataclass(frozen=True, slots=True)
class Bounds:
    """Largest accepted depth of a payload, and size of each kind of value."""

    depth: int
    map: int
    array: int
    text: int
    binary: int


class TooFar(Exception):  # noqa: N818 (a bound that was reached)
    """End of the second pass before the fault or field was found."""


class Fault(Exception):  # noqa: N818 (a finding, not a defect of ours)
    """Forbidden value in a payload.

    Attributes:
        offset: Byte at which the value begins.
    """

    def __init__(self, offset: int, text: str) -> None:
        super().__init__(text)
        self.offset = offset


_FIXED = {
    0xC0: ("nil", 0), 0xC2: ("a bool", 0), 0xC3: ("a bool", 0), 0xCA: ("a number", 4), 0xCB: ("a number", 8),
    0xCC: ("an integer", 1), 0xCD: ("an integer", 2), 0xCE: ("an integer", 4), 0xCF: ("an integer", 8),
    0xD0: ("an integer", 1), 0xD1: ("an integer", 2), 0xD2: ("an integer", 4), 0xD3: ("an integer", 8),
}  # fmt: skip
"""Kinds of fixed size: name, and number of bytes after the first."""

_SIZED = {
    0xC4: ("binary data", 1), 0xC5: ("binary data", 2), 0xC6: ("binary data", 4),
    0xD9: ("a text", 1), 0xDA: ("a text", 2), 0xDB: ("a text", 4),
    0xDC: ("an array", 2), 0xDD: ("an array", 4), 0xDE: ("a map", 2), 0xDF: ("a map", 4),
}  # fmt: skip
"""Kinds with an explicit size: name, and number of bytes of the size."""

_EXTENSIONS = {*range(0xC7, 0xCA), *range(0xD4, 0xD9)}


class Reader:
    """Reader of one payload, value by value.

    Args:
        payload: The payload.
        bounds: Bounds of its values.
    """

    def __init__(self, payload: bytes, bounds: Bounds) -> None:
        self._payload = payload
        self._limits = {"a map": bounds.map, "an array": bounds.array}
        self._limits |= {"a text": bounds.text, "binary data": bounds.binary}
        self._depth = bounds.depth
        self._at = self._read = 0
        self.offsets: dict[tuple[str | int, ...], int] = {}
        """Byte at which each value begins, by the path of keys and indices to it."""

    def read(self) -> None:
        """Read the whole payload.

        Raises:
            Fault: At the first forbidden value.
            TooFar: The first ``MAX_VALUES`` values contain no fault.
        """
        kind, _ = self._head()
        if kind != "a map":
            raise Fault(0, f"expected a map, got {kind}")
        self._at = 0
        self._value((), 1)
        if self._at < len(self._payload):
            raise Fault(
                self._at, f"expected the end of the payload, got {len(self._payload) - self._at} bytes"
            )

    def _value(self, path: tuple[str | int, ...], depth: int) -> str | None:
        """Read a value with its content; return it if it is a text."""
        begin = self.offsets[path] = self._at
        self._read += 1
        if self._read > MAX_VALUES:
            raise TooFar
        kind, size = self._head()
        limit = self._limits.get(kind)
        if limit is not None and size > limit:
            what = "items" if kind in ("an array", "a map") else "bytes"
            raise Fault(begin, f"{kind} of {size} {what}; at most {limit} are accepted")
        if kind in ("an array", "a map") and depth > self._depth:
            raise Fault(begin, f"nested deeper than {self._depth}")
        if kind == "an array":
            for index in range(size):
                self._value((*path, index), depth + 1)
        elif kind == "a map":
            self._map(path, depth, size)
        else:
            return self._bytes(begin, kind, size)
        return None

    def _map(self, path: tuple[str | int, ...], depth: int, size: int) -> None:
        keys = set()
        for _ in range(size):
            begin = self._at
            key = self._value((*path, ""), depth + 1)
            if key is None:
                raise Fault(begin, "a key of a map is not a text")
            if key in keys:
                raise Fault(begin, "a key occurs twice in one map")
            keys.add(key)
            self._value((*path, key), depth + 1)

    def _head(self) -> tuple[str, int]:
        """Read the head of a value; return its kind and the number of bytes, items or pairs that follow."""
        begin = self._at
        first = self._take(begin, 1)[0]
        if first < 0x80 or first >= 0xE0:
            return "an integer", 0
        if first < 0xC0:
            kind, mask = _short(first)
            return kind, first & mask
        if (fixed := _FIXED.get(first)) is not None:
            return fixed
        if (sized := _SIZED.get(first)) is not None:
            return sized[0], int.from_bytes(self._take(begin, sized[1]), "big")
        if first in _EXTENSIONS:
            raise Fault(begin, "a value of an extension type, which is not accepted")
        raise Fault(begin, f"no msgpack value begins with the byte 0x{first:02x}")

    def _bytes(self, begin: int, kind: str, size: int) -> str | None:
        data = self._take(begin, size)
        if kind != "a text":
            return None
        try:
            return data.decode()
        except UnicodeDecodeError:
            raise Fault(begin, "a text that is not UTF-8") from None

    def _take(self, begin: int, count: int) -> bytes:
        if self._at + count > len(self._payload):
            raise Fault(begin, "the payload ends inside this value")
        self._at += count
        return self._payload[self._at - count : self._at]


def _short(first: int) -> tuple[str, int]:
    if first < 0x90:
        return "a map", 0x0F
    return ("an array", 0x0F) if first < 0xA0 else ("a text", 0x1F)


def fault_in(payload: bytes, bounds: Bounds) -> str:
    """Describe the fault of a payload that the fast reader has refused, with its place if it was found."""
    try:
        Reader(payload, bounds).read()
    except Fault as fault:
        return f"byte {fault.offset}: {fault}"
    except TooFar:
        pass
    return "the payload is not a map of this protocol"


def offset_of(payload: bytes, path: Sequence[str | int], bounds: Bounds) -> int | None:
    """Return the byte at which a value of a well-formed payload begins; None if it was not found."""
    reader = Reader(payload, bounds)
    with suppress(TooFar):
        reader.read()
    return reader.offsets.get(tuple(path))


NAME_FORM = "1 to 64 of the characters A-Z a-z 0-9 _ . : / -"
_PATTERNS = {True: "64 hexadecimal digits, lower case", False: NAME_FORM}

_EXPECTED: Mapping[str, str] = {
    "string_type": "a text",
    "int_type": "an integer",
    "float_type": "a number",
    "bool_type": "a bool",
    "bytes_type": "binary data",
    "tuple_type": "an array",
    "dict_type": "a map",
    "model_type": "a map",
    "finite_number": "a finite number",
    "string_too_long": "at most {max_length} characters",
    "string_too_short": "at least {min_length} characters",
    "bytes_too_long": "at most {max_length} bytes",
    "too_long": "at most {max_length} items",
    "too_short": "at least {min_length} items",
    "greater_than_equal": "at least {ge}",
    "greater_than": "more than {gt}",
    "less_than_equal": "at most {le}",
    "less_than": "less than {lt}",
    "literal_error": "one of {expected}",
}
"""Expected forms of a field, by the kind of the validator's error."""


def expected_form(kind: str, context: Mapping[str, Any]) -> str:
    """Return the expected form of a field, from the validator's error."""
    if kind == "string_pattern_mismatch":
        return _PATTERNS["0-9a-f]{64}" in str(context.get("pattern"))]
    return _EXPECTED.get(kind, "the form that the specification gives").format(**context)
