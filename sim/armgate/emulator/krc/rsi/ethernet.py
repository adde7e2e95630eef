"""RSI Ethernet object of a KRC: address of the PC, and the elements that it sends and receives."""

from dataclasses import dataclass
from typing import Literal

from armgate.emulator.krc.errors import KrcError

A_AXES = ("A1", "A2", "A3", "A4", "A5", "A6")
E_AXES = ("E1", "E2", "E3", "E4", "E5", "E6")
CARTESIAN = ("X", "Y", "Z", "A", "B", "C")

Type = Literal["BOOL", "STRING", "LONG", "DOUBLE"]
Value = bool | str | int | float
ZERO: dict[Type, Value] = {"BOOL": False, "STRING": "", "LONG": 0, "DOUBLE": 0.0}
"""Initial value of an element, by type."""


@dataclass(frozen=True, slots=True)
class Element:
    """One value of a telegram or reply.

    Attributes:
        tag: Name of its XML element.
        attribute: Name of its attribute; empty if the value is the element's text.
        type: Type from the file.
        internal: True if the KRC itself provides or uses the value.
        hold: HOLDON: keep the last value if none comes.
    """

    tag: str
    attribute: str
    type: Type
    internal: bool
    hold: bool

    @property
    def name(self) -> str:
        """Name in the form of TAG: ``AK.A1``."""
        return f"{self.tag}.{self.attribute}" if self.attribute else self.tag


@dataclass(frozen=True, slots=True)
class Ethernet:
    """Content of an RSI Ethernet file.

    Attributes:
        host: IP_NUMBER: address of the PC.
        port: PORT on which the PC listens.
        sentype: SENTYPE: type that a reply must have.
        only_send: ONLYSEND: replies are neither expected nor read.
        sent: Sent elements in the order of the file, with ``DEF_`` names expanded to single values.
        received: Received elements in the order of the file.
    """

    host: str
    port: int
    sentype: str
    only_send: bool
    sent: tuple[Element, ...]
    received: tuple[Element, ...]

    def corrections(self, names: tuple[str, ...]) -> tuple[Element | None, ...]:
        """Return the received element that corrects each axis, found by its attribute: the tag is free.

        Raises:
            KrcError: Two groups have the same axis.
        """
        return tuple(self._correction(name) for name in names)

    def _correction(self, axis: str) -> Element | None:
        found = [e for e in self.received if e.attribute == axis and e.type == "DOUBLE" and not e.internal]
        if len(found) > 1:
            tags = " and ".join(element.tag for element in found)
            raise KrcError(f"RECEIVE: both {tags} have {axis}; expected one group that corrects axes")
        return found[0] if found else None
