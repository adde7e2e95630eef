"""Messages from values that are valid by construction, built without validation.

Validation takes most of the time in which a server makes a state. A server may omit it for its own messages,
if it made every value in the form and within the bounds of the model. `tests/world` compares such messages
with validated ones.
"""

from typing import Any, TypeVar

from pydantic import BaseModel

from armgate.protocol.messages import Message, Part

M = TypeVar("M", bound=Message | Part)

_set = object.__setattr__
_DEFAULTS: dict[type, dict[str, Any]] = {}
"""Defaults of each model that was built before."""


def unvalidated(model: type[M], **values: object) -> M:
    """Return a message or a part of one, equal to ``model(**values)`` for valid values.

    The values must be of the exact types of the fields, and every field without a default must be given.
    """
    message = model.__new__(model)
    # As pydantic's own `model_construct`, which is slower because it supports aliases and extra fields.
    _set(message, "__dict__", {**(_DEFAULTS.get(model) or _defaults(model)), **values})
    _set(message, "__pydantic_fields_set__", set(values))
    _set(message, "__pydantic_extra__", None)
    _set(message, "__pydantic_private__", None)
    return message


def _defaults(model: type[BaseModel]) -> dict[str, Any]:
    """Return the default of each field, in the order of the model, because messages keep this order."""
    found = _DEFAULTS[model] = {name: field.default for name, field in model.model_fields.items()}
    return found
