"""The parser of replies (``<Sen>``): strict, and each refusal says in plain words what is wrong."""

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum

from armgate.emulator.krc.ethernet import Element, Ethernet, Value
from armgate.emulator.krc.safexml import XmlError, read_xml

LIMIT = 1024
"""Longest reply that a KRC takes, bytes."""
_FLAGS = {"0": False, "1": True, "FALSE": False, "TRUE": True}
_NUMBER = re.compile(r"[-+]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][-+]?[0-9]+)?")
_IPOC = re.compile(r"[0-9]{1,20}")


class Fault(StrEnum):
    """Why a datagram was not taken as the reply of a cycle."""

    STRANGER = "stranger"
    XML = "xml"
    ROOT = "root"
    SENTYPE = "sentype"
    VALUE = "value"
    NO_IPOC = "no_ipoc"
    WRONG_IPOC = "wrong_ipoc"
    LATE = "late"
    DOUBLE = "double"


class ReplyError(Exception):
    """A datagram is no reply; the KRC goes on as if it had not come.

    Attributes:
        fault: What kind.
    """

    def __init__(self, fault: Fault, text: str) -> None:
        super().__init__(text)
        self.fault = fault


@dataclass(frozen=True, slots=True)
class Reply:
    """A well-formed reply.

    Attributes:
        ipoc: As it was written.
        values: What was received, by element; those that the reply lacks are not in it.
        unknown: Names in the reply that RECEIVE does not declare.
    """

    ipoc: str
    values: Mapping[Element, Value]
    unknown: tuple[str, ...]


class ReplyParser:
    """Reads replies as one KRC's file declares them.

    Args:
        ethernet: The file.
    """

    def __init__(self, ethernet: Ethernet) -> None:
        self._sentype = ethernet.sentype
        self._elements = {element.name: element for element in ethernet.received}

    def parse(self, data: bytes) -> Reply:
        """The reply in a datagram.

        Raises:
            ReplyError: It is none; says why.
        """
        try:
            root = read_xml(data, LIMIT)
        except XmlError as error:
            raise ReplyError(Fault.XML, str(error)) from error
        self._check_root(root)
        values: dict[Element, Value] = {}
        unknown = []
        ipoc = _ipoc(root)
        for name, text in _given(root):
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
            said = "no Type" if given is None else f"Type={given[:40]!r}"
            raise ReplyError(
                Fault.SENTYPE,
                f"<Sen> has {said}; the KRC's file says SENTYPE {self._sentype!r}: use the same",
            )


def _ipoc(root: ET.Element) -> str:
    if len(root.findall("IPOC")) != 1:
        raise ReplyError(
            Fault.NO_IPOC, f"{len(root.findall('IPOC'))} elements <IPOC>; expected one, the last element"
        )
    if root[-1].tag != "IPOC":
        raise ReplyError(Fault.NO_IPOC, f"<{root[-1].tag[:40]}> stands after <IPOC>; expected IPOC last")
    text = root[-1].text or ""
    if not _IPOC.fullmatch(text):
        raise ReplyError(Fault.NO_IPOC, f"IPOC {text[:40]!r}; expected digits only, as they were sent")
    return text


def _given(root: ET.Element) -> Iterator[tuple[str, str]]:
    """Each value's name and text."""
    for child in root[:-1]:
        if len(child):
            raise ReplyError(Fault.VALUE, f"<{child.tag[:40]}> holds elements; expected attributes or a text")
        for attribute, text in child.attrib.items():
            yield f"{child.tag}.{attribute}", text
        if not child.attrib:
            yield child.tag, child.text or ""


def _value(element: Element, text: str) -> Value:
    if element.type == "STRING":
        return text
    word = text.strip()
    if element.type == "BOOL" and word.upper() in _FLAGS:
        return _FLAGS[word.upper()]
    if element.type == "LONG" and re.fullmatch(r"[-+]?[0-9]{1,10}", word):
        return int(word)
    if element.type == "DOUBLE" and _NUMBER.fullmatch(word) and math.isfinite(float(word)):
        return float(word)
    hint = {"BOOL": "0 or 1", "LONG": "a whole number", "DOUBLE": "a finite number with a decimal point"}
    raise ReplyError(Fault.VALUE, f"{element.name}={text[:40]!r}; expected {hint[element.type]}")
