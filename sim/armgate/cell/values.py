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
)

from armgate.cell.names import NAME
from armgate.cell.units import Quantity, quantity, to_si


def _si(dimension: str) -> BeforeValidator:
    return BeforeValidator(lambda given: to_si(given, dimension))


def _not_zero(factor: float) -> float:
    if factor == 0.0:
        raise ValueError("a factor of 0; expected another number")
    return factor


Name = Annotated[str, StringConstraints(pattern=NAME)]
Length = Annotated[float, _si("length")]
Size = Annotated[Length, Field(gt=0.0)]
Angle = Annotated[float, _si("angle")]
Duration = Annotated[float, _si("time")]
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
    """What all parts share: strict, immutable, no unknown keys, no NaN and no infinity."""

    model_config = ConfigDict(
        strict=True, frozen=True, extra="forbid", allow_inf_nan=False, arbitrary_types_allowed=True
    )


class SparsePart(Part):
    """A part in which a key that is left out means something else than null: dumps leave it out too."""

    @model_serializer(mode="wrap")
    def _only_given(self, dump: SerializerFunctionWrapHandler) -> dict[str, object]:
        return {key: value for key, value in dump(self).items() if key in self.model_fields_set}
