"""Strict parser of replies (``<Sen>``), which the PC sends to answer telegrams."""

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import assert_never

from armgate.emulator.krc.errors import Fault, ReplyError, XmlError
from armgate.emulator.krc.rsi.ethernet import Element, Ethernet, Value
from armgate.emulator.krc.rsi.strict_xml import read_xml

LIMIT = 1024
"""Largest reply that a KRC accepts, bytes."""
_FLAGS = {"0": False, "1": True, "FALSE": False, "TRUE": True}
_NUMBER = re.compile(r"[-+]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][-+]?[0-9]+)?")
_IPOC = re.compile(r"[0-9]{1,20}")


@dataclass(frozen=True, slots=True)
class Reply:
    """Well-formed reply.

    Attributes:
        ipoc: IPOC as it was written.
        values: Received values by element, without the elements that the reply lacks.
        unknown: Names in the reply that RECEIVE does not declare.
    """

    ipoc: str
    values: Mapping[Element, Value]
    unknown: tuple[str, ...]


class ReplyParser:
    """Parser of replies with the elements that one KRC's file declares.

    Args:
        ethernet: Content of the file.
    """

    def __init__(self, ethernet: Ethernet) -> None:
        self._sentype = ethernet.sentype
        self._elements = {element.name: element for element in ethernet.received}

    def parse(self, data: bytes) -> Reply:
        """Return the reply in a datagram.

        Raises:
            ReplyError: The datagram is not a valid reply.
        """
        try:
            root = read_xml(data, LIMIT)
        except XmlError as error:
            raise ReplyError(Fault.XML, str(error)) from error
        self._check_root(root)
        values: dict[Element, Value] = {}
        unknown = []
        ipoc = _ipoc(root)
        for name, text in _named_texts(root):
            element = self._elements.get(name)
            if element is None:
                unknown.append(name)
            elif element in values:
                raise ReplyError(Fault.VALUE, f"{name} occurs twice; expected each value once")
            else:
                values[element] = _value(element, text)
        return Reply(ipoc, values, tuple(unknown))

    def _check_root(self, root: ET.Element) -> None:
        if root.tag != "Sen":
            raise ReplyError(Fault.ROOT, f"the outer element is <{root.tag[:40]}>; expected <Sen>")
        given = root.get("Type")
        if given != self._sentype:
            found = "no Type" if given is None else f"Type={given[:40]!r}"
            raise ReplyError(
                Fault.SENTYPE,
                f"<Sen> has {found}; the KRC's file has SENTYPE {self._sentype!r}: use the same",
            )


def _ipoc(root: ET.Element) -> str:
    if len(root.findall("IPOC")) != 1:
        raise ReplyError(
            Fault.NO_IPOC, f"{len(root.findall('IPOC'))} elements <IPOC>; expected one, the last element"
        )
    if root[-1].tag != "IPOC":
        raise ReplyError(Fault.NO_IPOC, f"<{root[-1].tag[:40]}> follows <IPOC>; expected IPOC last")
    text = root[-1].text or ""
    if not _IPOC.fullmatch(text):
        raise ReplyError(Fault.NO_IPOC, f"IPOC {text[:40]!r}; expected digits only, as they were sent")
    return text


def _named_texts(root: ET.Element) -> Iterator[tuple[str, str]]:
    """Yield name and text of each value."""
    for child in root[:-1]:
        if len(child):
            raise ReplyError(
                Fault.VALUE, f"<{child.tag[:40]}> contains elements; expected attributes or a text"
            )
        for attribute, text in child.attrib.items():
            yield f"{child.tag}.{attribute}", text
        if not child.attrib:
            yield child.tag, child.text or ""


def _value(element: Element, text: str) -> Value:
    word = text.strip()
    match element.type:
        case "STRING":
            return text
        case "BOOL":
            if word.upper() in _FLAGS:
                return _FLAGS[word.upper()]
            expected = "0 or 1"
        case "LONG":
            if re.fullmatch(r"[-+]?[0-9]{1,10}", word):
                return int(word)
            expected = "a whole number"
        case "DOUBLE":
            if _NUMBER.fullmatch(word) and math.isfinite(float(word)):
                return float(word)
            expected = "a finite number with a decimal point"
        case _:
            assert_never(element.type)
    raise ReplyError(Fault.VALUE, f"{element.name}={text[:40]!r}; expected {expected}")
