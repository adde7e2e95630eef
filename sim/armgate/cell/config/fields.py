"""Field types and base classes of the configuration models."""

from typing import Annotated

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PlainSerializer,
    SerializerFunctionWrapHandler,
    StringConstraints,
    model_serializer,
    model_validator,
)

from armgate.cell.config.units import Quantity, quantity, to_si
from armgate.cell.names import NAME
from armgate.cell.shapes import MAX_EXTENT


def _si(dimension: str) -> BeforeValidator:
    return BeforeValidator(lambda given: to_si(given, dimension))


def _not_zero(factor: float) -> float:
    if factor == 0.0:
        raise ValueError("a factor of 0; expected another number")
    return factor


MAX_ANGLE = 1e3
"""Largest angle of a placement, rad."""

MAX_TIME = 1e6
"""Longest time that can be configured, s."""

Name = Annotated[str, StringConstraints(pattern=NAME)]
"""Name of a robot, joint, frame or body."""
Account = Annotated[str, StringConstraints(pattern=f"{NAME}|^uid [0-9]{{1,10}}$")]
"""Name of a token, or the number of a user of this machine (``uid 1000``)."""
Length = Annotated[float, _si("length"), Field(ge=-MAX_EXTENT, le=MAX_EXTENT)]
"""Length or coordinate, m."""
Size = Annotated[Length, Field(gt=0.0)]
"""Positive length, m."""
Angle = Annotated[float, _si("angle"), Field(ge=-MAX_ANGLE, le=MAX_ANGLE)]
"""Angle, rad."""
Duration = Annotated[float, _si("time"), Field(le=MAX_TIME)]
"""Time, s."""
Period = Annotated[Duration, Field(gt=0.0)]
"""Positive time, s."""
Speed = Annotated[float, _si("length/s"), Field(gt=0.0)]
"""Positive speed, m/s."""
Acceleration = Annotated[float, _si("length/s²"), Field(gt=0.0)]
"""Positive acceleration, m/s²."""
Factor = Annotated[float, AfterValidator(_not_zero)]
"""Factor other than 0."""
JointValue = Annotated[
    Quantity,
    BeforeValidator(quantity),
    PlainSerializer(lambda read: read.given, return_type=float | str),
]
"""Position, speed or acceleration of a joint; its dimension is checked when the joint is known."""


class ConfigModel(BaseModel):
    """Base of all configuration models: strict, immutable, no unknown keys, no NaN and no infinity.

    An empty section (``surroundings:`` with nothing below) counts as absent if the section is optional. The
    text below a field is the field's description, from which the reference of the configuration is made.
    """

    model_config = ConfigDict(
        strict=True,
        frozen=True,
        extra="forbid",
        allow_inf_nan=False,
        arbitrary_types_allowed=True,
        use_attribute_docstrings=True,
    )

    @model_validator(mode="before")
    @classmethod
    def _without_empty_sections(cls, given: object) -> object:
        if not isinstance(given, dict):
            return given
        sections = {
            name
            for name, field in cls.model_fields.items()
            if isinstance(field.default, dict | BaseModel) or field.default == ()
        }
        return {key: value for key, value in given.items() if value is not None or key not in sections}


class SparseModel(ConfigModel):
    """Base of models in which an absent key and ``null`` differ: dumps leave absent keys out."""

    @model_serializer(mode="wrap")
    def _only_given(self, dump: SerializerFunctionWrapHandler) -> dict[str, object]:
        return {key: value for key, value in dump(self).items() if key in self.model_fields_set}
