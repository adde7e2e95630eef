"""The KRC's own RSI Ethernet file, as far as a link has to know it.

``<ROOT>`` holds ``<CONFIG>`` (IP_NUMBER, PORT, SENTYPE, ONLYSEND), ``<SEND>`` and ``<RECEIVE>``, each with
``<ELEMENTS><ELEMENT TAG TYPE INDX [HOLDON]/>…``. A dot in TAG makes an attribute.
"""

import re
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

from armgate.links.rsi.xml import XmlError, read_xml

LIMIT = 65536
"""Longest file that is read, bytes."""
_COMMENT = re.compile(rb"<!--.*?-->", re.DOTALL)


class EthernetError(ValueError):
    """A file is not what a link can work with; says what was expected."""


@dataclass(frozen=True, slots=True)
class Received:
    """One value that the KRC takes.

    Attributes:
        tag: Name of its XML element.
        attribute: Name of its attribute, empty for a text.
        type: BOOL, STRING, LONG or DOUBLE.
        hold: HOLDON: it keeps its last value where none came.
    """

    tag: str
    attribute: str
    type: str
    hold: bool


@dataclass(frozen=True, slots=True)
class Ethernet:
    """What the file says.

    Attributes:
        host: IP_NUMBER: the PC.
        port: PORT: where it listens.
        sentype: SENTYPE: how replies call themselves.
        only_send: ONLYSEND: replies are not read.
        sent: Tags that the KRC sends, without ``DEF_``.
        received: Values that it takes, in order.
    """

    host: str
    port: int
    sentype: str
    only_send: bool
    sent: tuple[str, ...]
    received: tuple[Received, ...]


def load_ethernet(path: Path) -> Ethernet:
    """The file's contents.

    Raises:
        EthernetError: It cannot be read, or is no such file.
    """
    try:
        with path.open("rb") as file:
            return read_ethernet(file.read(LIMIT + 1))
    except OSError as error:
        raise EthernetError(f"{path} cannot be read: {error.strerror}; expected the KRC's file") from error
    except EthernetError as error:
        raise EthernetError(f"{path}: {error}") from error


def read_ethernet(data: bytes) -> Ethernet:
    """The contents of a file.

    Raises:
        EthernetError: It is no such file.
    """
    try:
        # The file is a person's: comments are left out, as far as they can be told from what is refused.
        root = read_xml(_COMMENT.sub(b"", data), LIMIT)
    except XmlError as error:
        raise EthernetError(str(error)) from error
    if root.tag != "ROOT":
        raise EthernetError(f"the outer element is <{root.tag}>; expected <ROOT>")
    host, port, sentype = (_config(root, key) for key in ("IP_NUMBER", "PORT", "SENTYPE"))
    if not (port.isascii() and port.isdigit() and 1 <= int(port) <= 65535):
        raise EthernetError(f"PORT {port!r}; expected a number from 1 to 65535")
    only_send = _flag(root.findtext("CONFIG/ONLYSEND", "FALSE").strip(), "ONLYSEND")
    sent = tuple(one.get("TAG", "").removeprefix("DEF_") for one in root.iterfind("SEND/ELEMENTS/ELEMENT"))
    received = tuple(map(_received, root.iterfind("RECEIVE/ELEMENTS/ELEMENT")))
    return Ethernet(host, int(port), sentype, only_send, sent, received)


def _config(root: ET.Element, key: str) -> str:
    text = root.findtext(f"CONFIG/{key}", "").strip()
    if not text:
        raise EthernetError(f"<CONFIG><{key}> is missing or empty")
    return text


def _received(element: ET.Element) -> Received:
    tag, _, attribute = element.get("TAG", "").removeprefix("DEF_").partition(".")
    hold = _flag(element.get("HOLDON", "0"), f"RECEIVE: {tag}: HOLDON")
    return Received(tag, attribute, element.get("TYPE", ""), hold)


def _flag(text: str, where: str) -> bool:
    values = {"TRUE": True, "1": True, "FALSE": False, "0": False}
    if text.upper() not in values:
        raise EthernetError(f"{where} {text!r}; expected TRUE or FALSE")
    return values[text.upper()]
