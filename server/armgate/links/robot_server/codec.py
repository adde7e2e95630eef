"""Codec of the robot server's socket: length-prefixed frames, each a msgpack list of kind and fields.

Packing and reading follow from the annotations of the message dataclasses. A message of another shape, a
number that is not finite or a name that is not a string is an error, which ends the connection.
"""

import math
from collections.abc import Callable
from dataclasses import fields
from types import NoneType, UnionType
from typing import Any, get_args, get_origin, get_type_hints

import msgpack

from armgate.events import LinkChange, LinkState, Plan, PlanAnswer, PlanKey, Rebase, Tick
from armgate.links.robot_server.messages import (
    FORMAT,
    Heartbeat,
    Hello,
    Message,
    Refusal,
    ResumePoint,
    TickReport,
    Welcome,
)
from armgate.protocol.framing import FrameDecoder, FrameError, frame

LARGEST = 1 << 20
"""Longest message, bytes: even a plan of thousands of ticks is shorter."""

_KINDS: dict[type, str] = {
    Hello: "hello",
    Welcome: "welcome",
    Refusal: "refusal",
    Heartbeat: "beat",
    TickReport: "played",
    LinkChange: "change",
    PlanAnswer: "answer",
    Plan: "plan",
    Rebase: "rebase",
}
Form = tuple[Callable[[Any], Any], Callable[[Any], Any]]
"""Functions that pack and read a value."""


class CodecError(Exception):
    """Message that cannot be decoded, or that the peer must not send."""


def encode(message: Message) -> bytes:
    """Return the bytes of a message, length included."""
    pack, _ = _FORMS[type(message)]
    body: bytes = msgpack.packb([_KINDS[type(message)], *pack(message)])
    return frame(body)


class Decoder:
    """Decoder of a stream of messages."""

    def __init__(self) -> None:
        self._frames = FrameDecoder(LARGEST)

    def push(self, data: bytes) -> list[Message]:
        """Take bytes; return the messages that they complete.

        Raises:
            CodecError: A message is malformed; the rest of the stream cannot be read.
        """
        try:
            bodies = self._frames.feed(data)
        except FrameError as error:
            raise CodecError(str(error)) from error
        return [_decoded(body) for body in bodies]


def _decoded(body: bytes) -> Message:
    try:
        kind, *values = msgpack.unpackb(body, use_list=True)
        if kind == "hello" and values and values[0] != FORMAT:
            raise CodecError(f"format {values[0]!r} of the robot server's socket; expected {FORMAT}")
        _, read = _BY_KIND[kind]
        message: Message = read(values)
    except CodecError:
        raise
    except Exception as error:
        raise CodecError(f"a malformed message: {error!r}") from error
    return message


# --- packing and reading --------------------------------------------------------------------------------


def _exactly(kind: type) -> Form:
    def read(value: Any) -> Any:
        if type(value) is not kind:
            raise CodecError(f"{value!r:.60}; expected {kind.__name__}")
        return value

    return _same, read


def _same(value: Any) -> Any:
    return value


def _finite(value: Any) -> float:
    if type(value) is not float or not math.isfinite(value):
        raise CodecError(f"{value!r:.60}; expected a finite number")
    return value


def _state(value: Any) -> LinkState:
    return LinkState(value)


def _or_none(form: Form) -> Form:
    pack, read = form
    return (lambda v: None if v is None else pack(v)), (lambda v: None if v is None else read(v))


def _tuple(form: Form) -> Form:
    pack, read = form

    def read_all(values: Any) -> tuple[Any, ...]:
        if type(values) is not list:
            raise CodecError(f"{values!r:.60}; expected a list")
        return tuple([read(value) for value in values])

    return (lambda values: [pack(value) for value in values]), read_all


def _dataclass(kind: type) -> Form:
    hints = get_type_hints(kind)
    names = [field.name for field in fields(kind)]
    forms = [_form(hints[name]) for name in names]
    packs = list(zip(names, (pack for pack, _ in forms), strict=True))
    reads = [read for _, read in forms]

    def read_all(values: Any) -> Any:
        if type(values) is not list or len(values) != len(reads):
            raise CodecError(f"{values!r:.60}; expected the {len(reads)} values of {kind.__name__}")
        return kind(*[read(value) for read, value in zip(reads, values, strict=True)])

    return (lambda message: [pack(getattr(message, name)) for name, pack in packs]), read_all


_PLAIN: dict[Any, Form] = {
    str: _exactly(str),
    int: _exactly(int),
    bool: _exactly(bool),
    float: (float, _finite),
    LinkState: (str, _state),
}


def _form(hint: Any) -> Form:
    if hint in _PLAIN:
        return _PLAIN[hint]
    if get_origin(hint) is UnionType:
        (inner,) = [one for one in get_args(hint) if one is not NoneType]
        return _or_none(_form(inner))
    if get_origin(hint) is tuple:
        return _tuple(_form(get_args(hint)[0]))
    assert hint in (Tick, PlanKey, ResumePoint), hint
    return _dataclass(hint)


_FORMS: dict[type, Form] = {kind: _dataclass(kind) for kind in _KINDS}
_BY_KIND = {name: _FORMS[kind] for kind, name in _KINDS.items()}
