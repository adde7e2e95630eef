"""Words of an RSI Ethernet file: a virtual KRC refuses all others by name, so that none goes unnoticed."""

import re
import xml.etree.ElementTree as ET
from collections.abc import Set
from typing import NoReturn

from armgate.emulator.krc.errors import KrcError

_CONFIG = {"IP_NUMBER", "PORT", "SENTYPE", "ONLYSEND", "PROTOCOL"}
_OF_KRC2 = {"PROTOCOLLENGTH", "PROTCOLLENGTH", "INTERFACE"}
"""Words of a KRC2's file that change nothing for UDP."""

_ELEMENT = {"TAG", "TYPE", "INDX", "HOLDON", "UNIT"}


def refuse_unknown(root: ET.Element) -> None:
    """Go through the file from ROOT down.

    Raises:
        KrcError: A section, value or attribute is unknown, stands twice, or a text stands between them.
    """
    _look(root, {"CONFIG", "SEND", "RECEIVE"})
    for config in root.iterfind("CONFIG"):
        _look(config, _CONFIG | _OF_KRC2)
        for value in config:
            _look(value, set(), text=True)
    for section in (*root.iterfind("SEND"), *root.iterfind("RECEIVE")):
        _look(section, {"ELEMENTS"})
        for elements in section:
            _look(elements, {"ELEMENT"}, repeated=True)
            for element in elements:
                _look(element, set(), attributes=_ELEMENT)


def _look(
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
            _refuse(element, f"<{tag}> stands {tags.count(tag)} times", {"it once"})
    for name in element.attrib:
        if name not in attributes and not name.startswith("{"):
            _refuse(element, f"unknown attribute {name!r}", attributes)
    loose = ["" if text else element.text, *(child.tail for child in element)]
    if "".join(part or "" for part in loose).strip():
        _refuse(element, "text between elements", children)


def _refuse(element: ET.Element, what: str, expected: Set[str]) -> NoReturn:
    raise KrcError(f"<{element.tag}>: {what}; expected {', '.join(sorted(expected)) or 'nothing'}")


def refuse_encoding(start: str, ascii_only: bool) -> None:
    """Refuse a declared encoding in which the bytes of the file, which are UTF-8, mean another text.

    Raises:
        KrcError: The declaration names such an encoding.
    """
    declaration = start.partition("?>")[0] if start.startswith("<?xml") else ""
    found = re.search(r"encoding\s*=\s*.([\w.-]*)", declaration)
    name = found[1].lower() if found else "utf-8"
    harmless = name.startswith(("iso-8859-", "windows-125")) and ascii_only
    if name not in ("utf-8", "utf8", "us-ascii") and not harmless:
        raise KrcError(f"encoding {name!r} is declared, but the file is UTF-8; declare UTF-8")
