"""Filter for the messages of pages.

viser itself lets a page replace callbacks of shared buttons and upload files.

Only messages of controls on the viewer's page are admitted, with the fields and values that these controls
send.
"""

import dataclasses
import math
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

import msgspec
import viser
from viser import _messages

LARGEST = 16 * 1024
"""Largest message that a page may send, bytes."""
FARTHEST = 1000.0
"""Largest coordinate of a gizmo, m."""
_TEXT = 200
_LENGTHS = {"wxyz": 4, "position": 3, "look_at": 3, "up_direction": 3}


class ViolationError(Exception):
    """Message that the viewer's page never sends; the text gives the reason."""


class MessageFilter:
    """Filter for the messages of all pages of one server.

    Args:
        server: The server of viser.
    """

    def __init__(self, server: Any) -> None:
        self._server = server
        self._rules: Mapping[str, Callable[[Mapping[str, Any]], bool]] = {
            "ViewerCameraMessage": _camera,
            "GuiUpdateMessage": self._control,
            "TransformControlsUpdateMessage": self._gizmo_moved,
            "TransformControlsDragStartMessage": self._gizmo_held,
            "TransformControlsDragEndMessage": self._gizmo_held,
        }

    def admits(self, data: bytes | str) -> bool:
        """Return True if a message is admitted; False if it is ignored, such as that of a removed control.

        Raises:
            ViolationError: The page must be closed.
        """
        message = _decoded(data)
        kind = message.get("type")
        rule = self._rules.get(kind) if isinstance(kind, str) else None
        if rule is None:
            raise ViolationError(f"unexpected message {ascii(kind)[:60]}")
        _check_fields(str(kind), message)
        return rule(message)

    def _apis(self) -> list[Any]:
        return [self._server, *self._server.get_clients().values()]

    def _control(self, message: Mapping[str, Any]) -> bool:
        updates = message.get("updates")
        if not isinstance(updates, dict) or list(updates) != ["value"]:
            raise ViolationError("a control may change its value only")
        uuid = _text(message, "uuid")
        known = (api.gui._gui_input_handle_from_uuid.get(uuid) for api in self._apis())
        handle = next((handle for handle in known if handle is not None), None)
        return handle is not None and _fits(handle, updates["value"])

    def _gizmo_moved(self, message: Mapping[str, Any]) -> bool:
        wxyz, position = (_numbers(message, name) for name in ("wxyz", "position"))
        turned = abs(math.hypot(*wxyz) - 1.0) < 0.01
        return turned and all(abs(x) <= FARTHEST for x in position) and self._gizmo_held(message)

    def _gizmo_held(self, message: Mapping[str, Any]) -> bool:
        _text(message, "owner")
        name = _text(message, "name")
        return any(name in api.scene._handle_from_transform_controls_name for api in self._apis())


def _decoded(data: bytes | str) -> dict[str, Any]:
    if isinstance(data, str):
        raise ViolationError("expected a binary message")
    try:
        return msgspec.msgpack.decode(data, type=dict[str, Any])
    except (msgspec.MsgspecError, RecursionError, ValueError) as error:
        raise ViolationError("expected a message in msgpack") from error


def _check_fields(kind: str, message: Mapping[str, Any]) -> None:
    """Check that viser can read a message; otherwise viser closes the connection with a traceback."""
    required, known = _fields(kind)
    given = message.keys() - {"type"}
    if missing := required - given:
        raise ViolationError(f"{kind}: expected {', '.join(sorted(missing))}")
    if given - known:
        raise ViolationError(f"{kind}: unexpected fields")


@cache
def _fields(kind: str) -> tuple[frozenset[str], frozenset[str]]:
    """Return the required fields of a message, and all of them."""
    fields = dataclasses.fields(getattr(_messages, kind))
    required = (f.name for f in fields if f.default is f.default_factory is dataclasses.MISSING)
    return frozenset(required), frozenset(field.name for field in fields)


def _camera(message: Mapping[str, Any]) -> bool:
    finite = True
    for name, value in message.items():
        if name in _LENGTHS:
            finite &= all(map(math.isfinite, _numbers(message, name)))
        elif name != "type":
            finite &= math.isfinite(_number(value))
    return finite


def _fits(handle: Any, value: object) -> bool:
    """Return True if a control can have this value.

    Raises:
        ViolationError: The value is of another type.
    """
    match handle:
        case viser.GuiButtonHandle():
            fits = value is True
        case viser.GuiCheckboxHandle():
            fits = isinstance(value, bool)
        case viser.GuiDropdownHandle():
            fits = value in handle.options
        case viser.GuiSliderHandle():
            margin = 1e-6 * (handle.max - handle.min)
            return bool(handle.min - margin <= _number(value) <= handle.max + margin)
        case _:
            fits = False
    if not fits:
        raise ViolationError("a control cannot have this value")
    return True


def _number(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ViolationError("expected a number")
    return float(value)


def _numbers(message: Mapping[str, Any], name: str) -> list[float]:
    given = message.get(name)
    if not isinstance(given, list) or len(given) != _LENGTHS[name]:
        raise ViolationError(f"{name}: expected {_LENGTHS[name]} numbers")
    return [_number(value) for value in given]


def _text(message: Mapping[str, Any], name: str) -> str:
    given = message.get(name)
    if not isinstance(given, str) or len(given) > _TEXT:
        raise ViolationError(f"{name}: expected a text")
    return given
