"""Messages from values that are valid by construction, built without validation.

Validation takes most of the time in which a server makes a state. A server may omit it for its own messages,
if it made every value in the form and within the bounds of the model. `tests/world` compares such messages
with validated ones.
"""

from typing import Any, TypeVar

from pydantic import BaseModel

from armgate.protocol.messages import Message, Part

M = TypeVar("M", bound=Message | Part)

_GIVEN: dict[type, set[str]] = {}
"""Names of all fields but the type, of each model that was built before."""

# The attributes of every model, which pydantic's own `model_construct` sets, too. It is slower because it
# supports aliases and extra fields; setting them by name would be slower, too.
_slots = vars(BaseModel)
_set_values = _slots["__dict__"].__set__
_set_given = _slots["__pydantic_fields_set__"].__set__
_set_extra = _slots["__pydantic_extra__"].__set__
_set_private = _slots["__pydantic_private__"].__set__


def unvalidated(model: type[M], values: dict[str, Any], given: set[str] | None = None) -> M:
    """Return a message or a part of one, equal to a validated one with the same values.

    Args:
        model: Type of the message.
        values: Value of each field, of its exact type, in the order of the model; the message keeps this
            dict.
        given: Names of the fields that count as set, shared with the message; None: all but the type.
    """
    message: M = object.__new__(model)
    _set_values(message, values)
    _set_given(message, given or _GIVEN.get(model) or _fields(model))
    _set_extra(message, None)
    _set_private(message, None)
    return message


def _fields(model: type[BaseModel]) -> set[str]:
    found = _GIVEN[model] = set(model.model_fields) - {"type"}
    return found
