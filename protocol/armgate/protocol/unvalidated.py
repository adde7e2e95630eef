"""Messages from values that are valid by construction, built without validation.

Validation takes most of the time in which a server makes a state. A server may omit it for its own messages,
if it made every value in the form and within the bounds of the model. `tests/world` compares such messages
with validated ones.
"""

from typing import Any, TypeVar

from pydantic import BaseModel

from armgate.protocol.messages import Message, Part

M = TypeVar("M", bound=Message | Part)


def unvalidated(model: type[M], **values: object) -> M:
    """Return a message or a part of one, equal to ``model(**values)`` for valid values.

    The values must be of the exact types of the fields, and every field without a default must be given.
    """
    message = model.__new__(model)
    # As pydantic's own `model_construct`, which is slower because it supports aliases and extra fields.
    object.__setattr__(message, "__dict__", {**_defaults(model), **values})
    object.__setattr__(message, "__pydantic_fields_set__", set(values))
    object.__setattr__(message, "__pydantic_extra__", None)
    object.__setattr__(message, "__pydantic_private__", None)
    return message


_DEFAULTS: dict[type, dict[str, Any]] = {}


def _defaults(model: type[BaseModel]) -> dict[str, Any]:
    """Return the default of each field, in the order of the model, because messages keep this order."""
    known = _DEFAULTS.get(model)
    if known is None:
        known = _DEFAULTS[model] = {name: field.default for name, field in model.model_fields.items()}
    return known
