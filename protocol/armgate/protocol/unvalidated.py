"""Messages from values that are valid by construction, built without validation.

Validation takes most of the time in which a server makes a state. A server may omit it for its own messages,
if it made every value in the form and within the bounds of the model. `tests/world` compares such messages
with validated ones.
"""

from typing import Any, TypeVar

from pydantic import BaseModel

from armgate.protocol.messages import Message, Part

M = TypeVar("M", bound=Message | Part)

_DEFAULTS: dict[type, dict[str, Any]] = {}
"""Defaults of each model that was built before."""

_ALL: dict[type, set[str]] = {}
"""Names of the fields of each model that was assembled before."""

# The attributes of every model, which pydantic's own `model_construct` sets, too. It is slower because it
# supports aliases and extra fields; setting them by name would be slower, too.
_slots = vars(BaseModel)
_set_values = _slots["__dict__"].__set__
_set_given = _slots["__pydantic_fields_set__"].__set__
_set_extra = _slots["__pydantic_extra__"].__set__
_set_private = _slots["__pydantic_private__"].__set__


def unvalidated(model: type[M], **values: object) -> M:
    """Return a message or a part of one, equal to ``model(**values)`` for valid values.

    The values must be of the exact types of the fields, and every field without a default must be given.
    """
    message: M = object.__new__(model)
    _set_values(message, (_DEFAULTS.get(model) or _defaults(model)) | values)
    _set_given(message, set(values))
    _set_extra(message, None)
    _set_private(message, None)
    return message


def assembled(model: type[M], values: dict[str, Any], given: set[str] | None = None) -> M:
    """Return a message or a part of one from the values of all its fields; faster than `unvalidated`.

    Args:
        model: Type of the message.
        values: Values of all fields, in the order of the model; the message keeps this dict.
        given: Names of the fields that are not left at their defaults, shared with the message; None: all.
    """
    message: M = object.__new__(model)
    _set_values(message, values)
    _set_given(message, given or _ALL.get(model) or _ALL.setdefault(model, set(model.model_fields)))
    _set_extra(message, None)
    _set_private(message, None)
    return message


def _defaults(model: type[BaseModel]) -> dict[str, Any]:
    """Return the default of each field, in the order of the model, because messages keep this order."""
    found = _DEFAULTS[model] = {name: field.default for name, field in model.model_fields.items()}
    return found
