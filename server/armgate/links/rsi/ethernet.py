"""The KRC's own RSI Ethernet file, as far as a link has to know it.

``<ROOT>`` holds ``<CONFIG>`` (IP_NUMBER, PORT, SENTYPE, ONLYSEND), ``<SEND>`` and ``<RECEIVE>``, each with
``<ELEMENTS><ELEMENT TAG TYPE INDX [HOLDON]/>…``. A dot in TAG makes an attribute.
"""

from dataclasses import dataclass
from pathlib import Path

from armgate.links.rsi.xml import XmlError, read_xml

LIMIT = 65536
"""Longest file that is read, bytes."""


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


class _Collector:
    """Gathers what stands in CONFIG, and the ELEMENTs of SEND and RECEIVE."""

    def __init__(self) -> None:
        self.path: list[str] = []
        self.config: dict[str, str] = {}
        self.elements: dict[str, list[dict[str, str]]] = {"SEND": [], "RECEIVE": []}

    def start(self, depth: int, name: str, attributes: dict[str, str]) -> None:
        self.path[depth:] = [name]
        if name == "ELEMENT" and depth == 3 and self.path[1] in self.elements:
            self.elements[self.path[1]].append(attributes)

    def text(self, depth: int, piece: str) -> None:
        if depth == 2 and self.path[1] == "CONFIG":
            self.config[self.path[2]] = self.config.get(self.path[2], "") + piece.strip()


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
    found = _Collector()
    try:
        read_xml(data, LIMIT, found.start, found.text)
    except XmlError as error:
        raise EthernetError(str(error)) from error
    if found.path[:1] != ["ROOT"]:
        raise EthernetError(f"the outer element is <{found.path[0]}>; expected <ROOT>")
    for key in ("IP_NUMBER", "PORT", "SENTYPE"):
        if not found.config.get(key):
            raise EthernetError(f"<CONFIG><{key}> is missing or empty")
    port = found.config["PORT"]
    if not (port.isascii() and port.isdigit() and 1 <= int(port) <= 65535):
        raise EthernetError(f"PORT {port!r}; expected a number from 1 to 65535")
    sent = (element.get("TAG", "").removeprefix("DEF_") for element in found.elements["SEND"])
    received = tuple(map(_received, found.elements["RECEIVE"]))
    only_send = _flag(found.config.get("ONLYSEND", "FALSE"), "ONLYSEND")
    return Ethernet(
        found.config["IP_NUMBER"], int(port), found.config["SENTYPE"], only_send, tuple(sent), received
    )


def _received(element: dict[str, str]) -> Received:
    tag, _, attribute = element.get("TAG", "").removeprefix("DEF_").partition(".")
    hold = _flag(element.get("HOLDON", "0"), f"RECEIVE: {tag}: HOLDON")
    return Received(tag, attribute, element.get("TYPE", ""), hold)


def _flag(text: str, where: str) -> bool:
    values = {"TRUE": True, "1": True, "FALSE": False, "0": False}
    if text.upper() not in values:
        raise EthernetError(f"{where} {text!r}; expected TRUE or FALSE")
    return values[text.upper()]
