"""What all parts of the configuration are made of: names, values with units, strict models."""

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

from armgate.cell.names import NAME
from armgate.cell.units import MAX_EXTENT, Quantity, quantity, to_si


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
Account = Annotated[str, StringConstraints(pattern=f"{NAME}|^uid [0-9]{{1,10}}$")]
"""Name of a token, or a user of this machine by number."""
Length = Annotated[float, _si("length"), Field(ge=-MAX_EXTENT, le=MAX_EXTENT)]
Size = Annotated[Length, Field(gt=0.0)]
Angle = Annotated[float, _si("angle"), Field(ge=-MAX_ANGLE, le=MAX_ANGLE)]
Duration = Annotated[float, _si("time"), Field(le=MAX_TIME)]
Period = Annotated[Duration, Field(gt=0.0)]
Speed = Annotated[float, _si("length/s"), Field(gt=0.0)]
Acceleration = Annotated[float, _si("length/s²"), Field(gt=0.0)]
Factor = Annotated[float, AfterValidator(_not_zero)]
"""Anything but 0."""
JointValue = Annotated[
    Quantity,
    BeforeValidator(quantity),
    PlainSerializer(lambda read: read.given, return_type=float | str),
]
"""A joint's position, speed or acceleration: its dimension is checked when the joint is known."""


class Part(BaseModel):
    """What all parts share: strict, immutable, no unknown keys, no NaN and no infinity.

    An empty section (``surroundings:`` with nothing below) is the same as none, if it may be left out.
    """

    model_config = ConfigDict(
        strict=True, frozen=True, extra="forbid", allow_inf_nan=False, arbitrary_types_allowed=True
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


class SparsePart(Part):
    """A part in which a key that is left out means something else than null: dumps leave it out too."""

    @model_serializer(mode="wrap")
    def _only_given(self, dump: SerializerFunctionWrapHandler) -> dict[str, object]:
        return {key: value for key, value in dump(self).items() if key in self.model_fields_set}
