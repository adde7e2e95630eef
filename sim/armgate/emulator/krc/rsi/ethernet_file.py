"""Reader of RSI Ethernet files: strict, and unknown content is refused by name.

``<ROOT>`` holds ``<CONFIG>`` (IP_NUMBER, PORT, SENTYPE, ONLYSEND), ``<SEND>`` and ``<RECEIVE>``, each with
``<ELEMENTS><ELEMENT TAG TYPE INDX [HOLDON]/>…``. A dot in TAG denotes an attribute: ``AK.A1`` is
``<AK A1="…"/>``. Elements with INDX ``INTERNAL`` are values of the KRC; their TAG begins with ``DEF_``.
"""

import re
import xml.etree.ElementTree as ET
from collections.abc import Set
from typing import NoReturn, get_args

from armgate.emulator.krc.errors import KrcError, XmlError
from armgate.emulator.krc.rsi.ethernet import A_AXES, CARTESIAN, E_AXES, Element, Ethernet, Type
from armgate.emulator.krc.rsi.strict_xml import read_xml

LIMIT = 65536
"""Largest file that is read, bytes."""
CHANNELS = 64
"""Largest number in INDX."""

_DIGITS = re.compile("[0-9]{1,9}")
_BYTE_ORDER_MARK = b"\xef\xbb\xbf"
_WORD = "(?![xX][mM][lL])[A-Za-z_][A-Za-z0-9_]{0,63}"
_TAG = re.compile(rf"{_WORD}(\.{_WORD})?", re.ASCII)
_SENT: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(("RIst", "RSol"), CARTESIAN),
    **dict.fromkeys(("AIPos", "ASPos", "MACur"), A_AXES),
    **dict.fromkeys(("EIPos", "ESPos", "MECur"), E_AXES),
    "Delay": ("D",),
}
"""Internal values that a KRC sends, with their attributes."""

_TECH = re.compile(r"Tech\.(C[1-6]|T[2-6])", re.ASCII)
_REFUSED_TECH = "Tech.T1"
"""Internal value that a real KRC refuses at RSI_ON, as a public driver reports."""

_CONFIG = {"IP_NUMBER", "PORT", "SENTYPE", "ONLYSEND", "PROTOCOL"}
_KRC2_CONFIG = {"PROTOCOLLENGTH", "PROTCOLLENGTH", "INTERFACE"}
"""Settings in files of a KRC2 that have no effect with UDP."""

_ATTRIBUTES = {"TAG", "TYPE", "INDX", "HOLDON", "UNIT"}
"""Attributes of ``<ELEMENT>``."""


def read_ethernet(data: bytes) -> Ethernet:
    """Read an RSI Ethernet file.

    Raises:
        KrcError: It is not such a file, or a value is not what a KRC accepts; the text names the element.
    """
    root = _read_root(data)
    only_send = _flag(_text(root, "CONFIG/ONLYSEND"), "ONLYSEND")
    sent = [part for element in _elements(root, "SEND") for part in _sent(element)]
    received = [part for element in _elements(root, "RECEIVE") for part in _received(element)]
    for section, parts in (("SEND", sent), ("RECEIVE", received)):
        _refuse_duplicates(section, [part.name for part in parts])
    if not received and not only_send:
        raise KrcError("RECEIVE has no <ELEMENT>; expected at least one, or ONLYSEND TRUE")
    _check_protocol(root)
    host, port, sentype = (_text(root, f"CONFIG/{key}") for key in ("IP_NUMBER", "PORT", "SENTYPE"))
    if not (_DIGITS.fullmatch(port) and 1 <= int(port) <= 65535):
        raise KrcError(f"PORT {port!r}; expected a number from 1 to 65535")
    return Ethernet(host, int(port), sentype, only_send, tuple(sent), tuple(received))


def _read_root(data: bytes) -> ET.Element:
    try:
        root = read_xml(data, LIMIT)
    except XmlError as error:
        raise KrcError(str(error)) from error
    if root.tag != "ROOT":
        raise KrcError(f"the outer element is <{root.tag}>; expected <ROOT>")
    ascii_only = data.removeprefix(_BYTE_ORDER_MARK).isascii()
    _refuse_encoding(data[:256].decode("utf-8-sig", "replace"), ascii_only)
    _refuse_unknown(root)
    return root


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


def _check_protocol(root: ET.Element) -> None:
    protocol = (root.findtext("CONFIG/PROTOCOL") or "").strip() or "UDP"
    if protocol.upper() != "UDP":
        raise KrcError(f"PROTOCOL {protocol!r}; expected UDP")


def _elements(root: ET.Element, section: str) -> list[ET.Element]:
    elements = root.findall(f"{section}/ELEMENTS/ELEMENT")
    indices = [index for element in elements if (index := element.get("INDX")) != "INTERNAL"]
    for index in indices:
        if not (index and _DIGITS.fullmatch(index) and 1 <= int(index) <= CHANNELS):
            raise KrcError(f"{section}: INDX={index!r}; expected INTERNAL or a number from 1 to {CHANNELS}")
    _refuse_duplicates(f"{section}, INDX", [str(int(index)) for index in indices if index])
    return elements


def _refuse_duplicates(where: str, names: list[str]) -> None:
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
        raise KrcError(f"{section}: every telegram contains IPOC already; remove the element")
    if internal and not tag.startswith("DEF_"):
        raise KrcError(
            f"{section}: {tag} has INDX=INTERNAL; expected a name that begins with DEF_, or a number"
        )
    if internal and name == _REFUSED_TECH:
        raise KrcError(f"{section}: {tag}: RSIBad at RSI_ON for the generator T1; expected T2 to T6")
    for known in get_args(Type):
        if type_ == known:
            hold = _flag(element.get("HOLDON", "0"), f"{section}: {tag}: HOLDON")
            group, _, attribute = name.partition(".")
            return Element(group, attribute, known, internal, hold)
    raise KrcError(f"{section}: {tag}: TYPE={type_!r}; expected one of {', '.join(get_args(Type))}")


def _expand(element: Element, attributes: tuple[str, ...]) -> list[Element]:
    """Return one element for each attribute of an internal value."""
    return [Element(element.tag, name, element.type, True, element.hold) for name in attributes]


def _tech(element: Element) -> list[Element] | None:
    """Return the ten parameters of a function generator: ``DEF_Tech.C1`` has C11 to C110."""
    found = _TECH.fullmatch(element.name)
    return found and _expand(element, tuple(f"{found[1]}{number}" for number in range(1, 11)))


def _sent(given: ET.Element) -> list[Element]:
    element = _plain(given, "SEND")
    if not element.internal:
        return [element]
    if not element.attribute and element.tag in _SENT:
        return _expand(element, _SENT[element.tag])
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
        raise KrcError(f"RECEIVE: the KRC accepts no DEF_{element.name}; expected one of {known}")
    return parts


# --- unknown content ---------------------------------------------------------------------------------


def _refuse_unknown(root: ET.Element) -> None:
    """Refuse a file with an unknown or repeated section, setting or attribute, or with text between them."""
    _check_content(root, {"CONFIG", "SEND", "RECEIVE"})
    for config in root.iterfind("CONFIG"):
        _check_content(config, _CONFIG | _KRC2_CONFIG)
        for value in config:
            _check_content(value, set(), text=True)
    for section in (*root.iterfind("SEND"), *root.iterfind("RECEIVE")):
        _check_content(section, {"ELEMENTS"})
        for elements in section:
            _check_content(elements, {"ELEMENT"}, repeated=True)
            for element in elements:
                _check_content(element, set(), attributes=_ATTRIBUTES)


def _check_content(
    element: ET.Element,
    children: Set[str],
    *,
    attributes: Set[str] = frozenset(),
    text: bool = False,
    repeated: bool = False,
) -> None:
    tags = [child.tag for child in element]
    for tag in tags:
        if tag not in children:
            _refuse(element, f"unknown element <{tag}>", children)
        if tags.count(tag) > 1 and not repeated:
            _refuse(element, f"<{tag}> occurs {tags.count(tag)} times", {"it once"})
    for name in element.attrib:
        if name not in attributes and not name.startswith("{"):
            _refuse(element, f"unknown attribute {name!r}", attributes)
    loose = ["" if text else element.text, *(child.tail for child in element)]
    if "".join(part or "" for part in loose).strip():
        _refuse(element, "text between elements", children)


def _refuse(element: ET.Element, what: str, expected: Set[str]) -> NoReturn:
    raise KrcError(f"<{element.tag}>: {what}; expected {', '.join(sorted(expected)) or 'nothing'}")


def _refuse_encoding(start: str, ascii_only: bool) -> None:
    """Refuse a declared encoding in which the file, which is UTF-8, would have another text."""
    declaration = start.partition("?>")[0] if start.startswith("<?xml") else ""
    found = re.search(r"encoding\s*=\s*.([\w.-]*)", declaration)
    name = found[1].lower() if found else "utf-8"
    harmless = name.startswith(("iso-8859-", "windows-125")) and ascii_only
    if name not in ("utf-8", "utf8", "us-ascii") and not harmless:
        raise KrcError(f"encoding {name!r} is declared, but the file is UTF-8; declare UTF-8")
