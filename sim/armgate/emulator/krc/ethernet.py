"""The KRC's own file: which elements its RSI Ethernet object sends and receives.

``<ROOT>`` holds ``<CONFIG>`` (IP_NUMBER, PORT, SENTYPE, ONLYSEND), ``<SEND>`` and ``<RECEIVE>``, each with
``<ELEMENTS><ELEMENT TAG TYPE INDX [HOLDON]/>…``. A dot in TAG makes an attribute: ``AK.A1`` is
``<AK A1="…"/>``. What INDX calls ``INTERNAL`` the KRC fills in itself; its TAG begins with ``DEF_``.
"""

import re
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from typing import Literal, get_args

from armgate.emulator.krc.errors import KrcError
from armgate.emulator.krc.filewords import refuse_encoding, refuse_unknown
from armgate.emulator.krc.safexml import XmlError, read_xml

LIMIT = 65536
"""Longest file that is read, bytes."""
CHANNELS = 64
"""Numbers that INDX may have."""
A_AXES = ("A1", "A2", "A3", "A4", "A5", "A6")
E_AXES = ("E1", "E2", "E3", "E4", "E5", "E6")

Type = Literal["BOOL", "STRING", "LONG", "DOUBLE"]
Value = bool | str | int | float
ZERO: dict[Type, Value] = {"BOOL": False, "STRING": "", "LONG": 0, "DOUBLE": 0.0}
"""What an element of each type is before anything was received."""

_DIGITS = re.compile("[0-9]{1,9}")
_MARK = b"\xef\xbb\xbf"
_WORD = "(?![xX][mM][lL])[A-Za-z_][A-Za-z0-9_]{0,63}"
_TAG = re.compile(rf"{_WORD}(\.{_WORD})?", re.ASCII)
CARTESIAN = ("X", "Y", "Z", "A", "B", "C")
_SENT: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(("RIst", "RSol"), CARTESIAN),
    **dict.fromkeys(("AIPos", "ASPos", "MACur"), A_AXES),
    **dict.fromkeys(("EIPos", "ESPos", "MECur"), E_AXES),
    "Delay": ("D",),
}
_TECH = re.compile(r"Tech\.(C[1-6]|T[2-6])", re.ASCII)
_BAD = "Tech.T1"
"""A KRC refuses it at RSI_ON (seen with a public driver)."""


@dataclass(frozen=True, slots=True)
class Element:
    """One value of a telegram.

    Attributes:
        tag: Name of its XML element.
        attribute: Name of its attribute; empty where the value is the element's text.
        type: As the file says.
        internal: Whether the KRC fills it in, or reads it, itself.
        hold: HOLDON: keep the last value when none came.
    """

    tag: str
    attribute: str
    type: Type
    internal: bool
    hold: bool

    @property
    def name(self) -> str:
        """As a TAG writes it."""
        return f"{self.tag}.{self.attribute}" if self.attribute else self.tag


@dataclass(frozen=True, slots=True)
class Ethernet:
    """What the file says.

    Attributes:
        host: IP_NUMBER: where the PC is.
        port: PORT: on which it listens.
        sentype: What a reply must call itself.
        only_send: ONLYSEND: replies are neither expected nor read.
        sent: In the order of the file, ``DEF_`` names spelt out value by value.
        received: In the order of the file.
    """

    host: str
    port: int
    sentype: str
    only_send: bool
    sent: tuple[Element, ...]
    received: tuple[Element, ...]

    def corrections(self, names: tuple[str, ...]) -> tuple[Element | None, ...]:
        """The received element that corrects each axis, by its attribute: the tag may have any name.

        Raises:
            KrcError: Two groups carry the same axis.
        """
        return tuple(self._correction(name) for name in names)

    def _correction(self, axis: str) -> Element | None:
        found = [e for e in self.received if e.attribute == axis and e.type == "DOUBLE" and not e.internal]
        if len(found) > 1:
            tags = " and ".join(element.tag for element in found)
            raise KrcError(f"RECEIVE: both {tags} carry {axis}; expected one group that corrects axes")
        return found[0] if found else None


def read_ethernet(data: bytes) -> Ethernet:
    """Reads the file.

    Raises:
        KrcError: It is no such file, or a value is not what a KRC takes; the text names the element.
    """
    try:
        root = read_xml(data, LIMIT)
    except XmlError as error:
        raise KrcError(str(error)) from error
    if root.tag != "ROOT":
        raise KrcError(f"the outer element is <{root.tag}>; expected <ROOT>")
    refuse_encoding(data[:256].decode("utf-8-sig", "replace"), data.removeprefix(_MARK).isascii())
    refuse_unknown(root)
    only_send = _flag(_text(root, "CONFIG/ONLYSEND"), "ONLYSEND")
    sent = [part for element in _elements(root, "SEND") for part in _sent(element)]
    received = [part for element in _elements(root, "RECEIVE") for part in _received(element)]
    for section, parts in (("SEND", sent), ("RECEIVE", received)):
        _refuse_doubles(section, [part.name for part in parts])
    if not received and not only_send:
        raise KrcError("RECEIVE has no <ELEMENT>; expected at least one, or ONLYSEND TRUE")
    _refuse_protocols(root)
    host, port, sentype = (_text(root, f"CONFIG/{key}") for key in ("IP_NUMBER", "PORT", "SENTYPE"))
    if not (_DIGITS.fullmatch(port) and 1 <= int(port) <= 65535):
        raise KrcError(f"PORT {port!r}; expected a number from 1 to 65535")
    return Ethernet(host, int(port), sentype, only_send, tuple(sent), tuple(received))


def _text(root: ET.Element, path: str) -> str:
    text = (root.findtext(path) or "").strip()
    if not text:
        raise KrcError(f"<{path.replace('/', '><')}> is missing or empty")
    return text


def _flag(text: str, where: str) -> bool:
    values = {"TRUE": True, "1": True, "FALSE": False, "0": False}
    if not text.isascii() or text.upper() not in values:
        raise KrcError(f"{where} {text!r}; expected TRUE or FALSE")
    return values[text.upper()]


def _refuse_protocols(root: ET.Element) -> None:
    protocol = (root.findtext("CONFIG/PROTOCOL") or "").strip() or "UDP"
    if protocol.upper() != "UDP":
        raise KrcError(f"PROTOCOL {protocol!r}; expected UDP")


def _elements(root: ET.Element, section: str) -> list[ET.Element]:
    elements = root.findall(f"{section}/ELEMENTS/ELEMENT")
    indices = [index for element in elements if (index := element.get("INDX")) != "INTERNAL"]
    for index in indices:
        if not (index and _DIGITS.fullmatch(index) and 1 <= int(index) <= CHANNELS):
            raise KrcError(f"{section}: INDX={index!r}; expected INTERNAL or a number from 1 to {CHANNELS}")
    _refuse_doubles(f"{section}, INDX", [str(int(index)) for index in indices if index])
    return elements


def _refuse_doubles(where: str, names: list[str]) -> None:
    for number, name in enumerate(names):
        if name in names[:number]:
            raise KrcError(f"{where}: {name} occurs twice; expected each once")


def _plain(element: ET.Element, section: str) -> Element:
    tag, type_ = element.get("TAG", ""), element.get("TYPE", "")
    internal = element.get("INDX") == "INTERNAL"
    name = tag.removeprefix("DEF_") if internal else tag
    if not _TAG.fullmatch(name):
        raise KrcError(
            f"{section}: TAG={tag[:80]!r}; expected a name like AK.A1: letters first, digits after them, at "
            f"most 64, and not xml at its beginning"
        )
    if name.partition(".")[0] == "IPOC":
        raise KrcError(f"{section}: IPOC stands in every telegram by itself; remove the element")
    if internal and not tag.startswith("DEF_"):
        raise KrcError(
            f"{section}: {tag} has INDX=INTERNAL; expected a name that begins with DEF_, or a number"
        )
    if internal and name == _BAD:
        raise KrcError(f"{section}: {tag}: RSIBad at RSI_ON for the generator T1; expected T2 to T6")
    for known in get_args(Type):
        if type_ == known:
            hold = _flag(element.get("HOLDON", "0"), f"{section}: {tag}: HOLDON")
            group, _, attribute = name.partition(".")
            return Element(group, attribute, known, internal, hold)
    raise KrcError(f"{section}: {tag}: TYPE={type_!r}; expected one of {', '.join(get_args(Type))}")


def _spread(element: Element, attributes: tuple[str, ...]) -> list[Element]:
    return [Element(element.tag, name, element.type, True, element.hold) for name in attributes]


def _tech(element: Element) -> list[Element] | None:
    """``DEF_Tech.C1`` stands for ten parameters, C11 to C110."""
    found = _TECH.fullmatch(element.name)
    return found and _spread(element, tuple(f"{found[1]}{number}" for number in range(1, 11)))


def _sent(given: ET.Element) -> list[Element]:
    element = _plain(given, "SEND")
    if not element.internal:
        return [element]
    if not element.attribute and element.tag in _SENT:
        return _spread(element, _SENT[element.tag])
    parts = _tech(element)
    if parts is None:
        known = ", ".join(f"DEF_{name}" for name in (*_SENT, "Tech.C1…C6", "Tech.T2…T6"))
        raise KrcError(f"SEND: the KRC has no DEF_{element.name}; expected one of {known}")
    return parts


def _received(given: ET.Element) -> list[Element]:
    element = _plain(given, "RECEIVE")
    if not element.internal or element.name == "EStr":
        return [element]
    parts = _tech(element)
    if parts is None:
        known = "DEF_EStr, DEF_Tech.C1…C6, DEF_Tech.T2…T6"
        raise KrcError(f"RECEIVE: the KRC takes no DEF_{element.name}; expected one of {known}")
    return parts
