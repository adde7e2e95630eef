"""Reader of the KRC's own RSI Ethernet file, as far as a link needs it.

``<ROOT>`` holds ``<CONFIG>`` (IP_NUMBER, PORT, SENTYPE, ONLYSEND), ``<SEND>`` and ``<RECEIVE>``, each with
``<ELEMENTS><ELEMENT TAG TYPE INDX [HOLDON]/>…``. A dot in TAG makes an attribute.
"""

import re
import xml.etree.ElementTree as ET
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from armgate.links.rsi.axes import A_AXES, E_AXES
from armgate.links.rsi.ethernet_vocabulary import encoding_objection, vocabulary_objection
from armgate.links.rsi.xml import XmlError, read_xml

LIMIT = 65536
"""Longest file that is read, bytes."""
_CHANNELS = 64
"""Largest value of INDX."""
_TYPES = ("BOOL", "STRING", "LONG", "DOUBLE")
_NUMBER = re.compile(r"[0-9]{1,9}")
_NAME = re.compile(r"(?!xml)[A-Za-z_][A-Za-z0-9_]{0,63}", re.ASCII | re.IGNORECASE)
"""Names in a telegram; XML reserves those that begin with xml."""

_TECH = r"Tech\.(C[1-6]|T[2-6])"
_REJECTED = "Tech.T1"
_KNOWN = {
    "SEND": re.compile(rf"RIst|RSol|A[IS]Pos|E[IS]Pos|MACur|MECur|Delay|{_TECH}"),
    "RECEIVE": re.compile(rf"EStr|{_TECH}"),
}
"""Names of values that a KRC fills in or reads itself."""
_EXAMPLES = {"SEND": "DEF_AIPos", "RECEIVE": "DEF_EStr"}
_SPREAD = {
    **dict.fromkeys(("RIst", "RSol"), ("X", "Y", "Z", "A", "B", "C")),
    **dict.fromkeys(("AIPos", "ASPos", "MACur"), A_AXES),
    **dict.fromkeys(("EIPos", "ESPos", "MECur"), E_AXES),
    "Delay": ("D",),
}
"""Attributes of these values."""


class EthernetError(ValueError):
    """File that a link cannot use; the text names what was expected."""


@dataclass(frozen=True, slots=True)
class Received:
    """Value that the KRC reads.

    Attributes:
        tag: Name of its XML element.
        attribute: Name of its attribute; empty if the value is the element's text.
        type: BOOL, STRING, LONG or DOUBLE.
        hold: HOLDON: the KRC keeps its last value if none came.
        internal: True if the KRC itself uses it, such as EStr.
    """

    tag: str
    attribute: str
    type: str
    hold: bool
    internal: bool = False

    @property
    def name(self) -> str:
        """Name in the form of a TAG."""
        return f"{self.tag}.{self.attribute}" if self.attribute else self.tag


@dataclass(frozen=True, slots=True)
class Ethernet:
    """Contents of the file.

    Attributes:
        host: IP_NUMBER, the address of the PC.
        port: PORT on which the PC listens.
        sentype: SENTYPE, the Type attribute of replies.
        only_send: ONLYSEND: True if the KRC reads no replies.
        sent: Values that the KRC fills in itself, without ``DEF_``.
        received: Values that the KRC reads, in order.
    """

    host: str
    port: int
    sentype: str
    only_send: bool
    sent: tuple[str, ...]
    received: tuple[Received, ...]


def load_ethernet(path: Path) -> Ethernet:
    """Return the contents of a file.

    Raises:
        EthernetError: The file cannot be read, or is not an RSI Ethernet file.
    """
    try:
        with path.open("rb") as file:
            return read_ethernet(file.read(LIMIT + 1))
    except OSError as error:
        raise EthernetError(f"{path} cannot be read: {error.strerror}; expected the KRC's file") from error
    except EthernetError as error:
        raise EthernetError(f"{path}: {error}") from error


def read_ethernet(data: bytes) -> Ethernet:
    """Return the contents of a file.

    Anything that a KRC would reject at RSI_ON, or that would make telegrams unreadable, is rejected.

    Raises:
        EthernetError: It is not an RSI Ethernet file.
    """
    try:
        root = read_xml(data, LIMIT, comments=True)
    except XmlError as error:
        raise EthernetError(str(error)) from error
    if root.tag != "ROOT":
        raise EthernetError(f"the outer element is <{root.tag}>; expected <ROOT>")
    objection = encoding_objection(data.decode("utf-8-sig")) or vocabulary_objection(root)
    if objection is not None:
        raise EthernetError(objection)
    host, port, sentype, only = (_config(root, k) for k in ("IP_NUMBER", "PORT", "SENTYPE", "ONLYSEND"))
    if not (_NUMBER.fullmatch(port) and 1 <= int(port) <= 65535):
        raise EthernetError(f"PORT {port!r}; expected a number from 1 to 65535")
    protocol = root.findtext("CONFIG/PROTOCOL", "").strip() or "UDP"
    if protocol.upper() != "UDP":
        raise EthernetError(f"PROTOCOL {protocol!r}; expected UDP, or no PROTOCOL: TCP is not supported")
    only_send = _flag(only, "ONLYSEND")
    sent = [_value(one, "SEND") for one in _elements(root, "SEND")]
    received = [_value(one, "RECEIVE") for one in _elements(root, "RECEIVE")]
    if not received and not only_send:
        raise EthernetError("RECEIVE has no <ELEMENT>; expected one for each axis, like AK.A1")
    for section, values in (("SEND", sent), ("RECEIVE", received)):
        _reject_repeated(f"{section}:", [name for value in values for name in value.names])
    tags = tuple(value.name for value in sent if value.internal)
    return Ethernet(host, int(port), sentype, only_send, tags, tuple(v.received for v in received))


@dataclass(frozen=True, slots=True)
class _Value:
    """One <ELEMENT>."""

    name: str
    type: str
    internal: bool
    hold: bool

    @property
    def names(self) -> list[str]:
        """Names of the values that it stands for."""
        spread = _SPREAD.get(self.name) if self.internal else None
        if self.internal and self.name.startswith("Tech."):
            return [f"{self.name}{number}" for number in range(1, 11)]
        return [self.name] if spread is None else [f"{self.name}.{part}" for part in spread]

    @property
    def received(self) -> Received:
        """Element as a value that the KRC reads."""
        tag, _, attribute = self.name.partition(".")
        return Received(tag, attribute, self.type, self.hold, self.internal)


def _elements(root: ET.Element, section: str) -> list[ET.Element]:
    found = list(root.iterfind(f"{section}/ELEMENTS/ELEMENT"))
    numbers = []
    for element in found:
        index = element.get("INDX", "")
        if index == "INTERNAL":
            continue
        if not (_NUMBER.fullmatch(index) and 1 <= int(index) <= _CHANNELS):
            tag = element.get("TAG", "")
            raise EthernetError(
                f"{section}: {tag}: INDX={index!r}; expected INTERNAL or a number from 1 to {_CHANNELS}"
            )
        numbers.append(str(int(index)))
    _reject_repeated(f"{section}: INDX", numbers)
    return found


def _value(element: ET.Element, section: str) -> _Value:
    tag, type_ = element.get("TAG", ""), element.get("TYPE", "")
    internal = element.get("INDX") == "INTERNAL"
    name = tag.removeprefix("DEF_") if internal else tag
    group, dot, attribute = name.partition(".")
    for part in (group, attribute) if dot else (group,):
        if not _NAME.fullmatch(part):
            raise EthernetError(
                f"{section}: TAG={tag[:80]!r}: {part[:80]!r} is not a valid XML name; expected at most 64 "
                f"letters, digits and underscores that begin with a letter and not with xml, like AK.A1"
            )
    if group == "IPOC":
        raise EthernetError(f"{section}: {tag}: every telegram has IPOC; remove the element")
    if type_ not in _TYPES:
        raise EthernetError(f"{section}: {tag}: TYPE={type_!r}; expected one of {', '.join(_TYPES)}")
    if internal and name == _REJECTED:
        raise EthernetError(f"{section}: {tag}: a KRC rejects it at RSI_ON (RSIBad); expected T2 to T6")
    if internal and not (tag.startswith("DEF_") and _KNOWN[section].fullmatch(name)):
        raise EthernetError(
            f"{section}: {tag} has INDX=INTERNAL, but a KRC has no such value in {section}; expected a "
            f"number, or a name like {_EXAMPLES[section]}"
        )
    hold = _flag(element.get("HOLDON", "0"), f"{section}: {tag}: HOLDON")
    return _Value(name, type_, internal, hold)


def _reject_repeated(where: str, names: list[str]) -> None:
    for name, count in Counter(names).items():
        if count > 1:
            raise EthernetError(f"{where} {name} occurs {count} times; expected each once")


def _config(root: ET.Element, key: str) -> str:
    text = root.findtext(f"CONFIG/{key}", "").strip()
    if not text:
        raise EthernetError(f"<CONFIG><{key}> is missing or empty")
    return text


def _flag(text: str, where: str) -> bool:
    values = {"TRUE": True, "1": True, "FALSE": False, "0": False}
    if not text.isascii() or text.upper() not in values:
        raise EthernetError(f"{where} {text!r}; expected TRUE or FALSE")
    return values[text.upper()]
