"""The telegrams of RSI: reads what a KRC sends (``<Rob>``), writes what it takes (``<Sen>``)."""

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass
from xml.sax.saxutils import quoteattr

from armgate.cell.events import Joints
from armgate.links.rsi.axes import AXES, Axis
from armgate.links.rsi.ethernet import Ethernet
from armgate.links.rsi.xml import XmlError, read_xml

LIMIT = 4096
"""Longest telegram that is read, bytes: one with everything that RSI can send has less than half of it."""
LONGEST_REPLY = 1024
"""More a KRC does not take, bytes."""
_DIGITS = re.compile(r"\s*([0-9]{1,20})\s*")
_DELAY_DIGITS = 10
_DELAY = re.compile(rf"([0-9]{{1,{_DELAY_DIGITS}}})(\.0*)?")
_NUMBER = re.compile(r"[-+]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][-+]?[0-9]+)?")
_NOT_READ = (
    "which is not supported: expected AIPos, ASPos, Delay and IPOC directly in <Rob>, as RSI sends them"
)
_VALUE = rb"[-+.0-9]{1,32}"
_DELAY_VALUE = rb"[0-9]{1,%d}" % _DELAY_DIGITS
_FREE = re.compile(rb'="(' + _VALUE + rb')"')
_MEASURED, _PROGRAMMED = ("AIPos", "EIPos"), ("ASPos", "ESPos")
_IPOC = re.compile(rb"<IPOC>[0-9]{1,20}</IPOC>")


class TelegramError(Exception):
    """A datagram is no telegram of a KRC; says why.

    Attributes:
        kind: A word for counting: ``xml``, ``root``, ``form``, ``ipoc``, ``element``, ``value``.
    """

    def __init__(self, kind: str, text: str) -> None:
        super().__init__(text)
        self.kind = kind


@dataclass(frozen=True, slots=True)
class Telegram:
    """One telegram of a KRC.

    Attributes:
        data: Its bytes.
        ipoc: Its number.
        short: Whether it is RSI 2's first frame, nothing but the IPOC; then there is no more in it.
        delay: How many cycles were late so far.
        q: Measured position, rad or m, in the order of the model.
        programmed: The position that the KRC's program holds, likewise; empty if it is not read.
    """

    data: bytes
    ipoc: int
    short: bool
    delay: int
    q: Joints
    programmed: Joints

    def decimals(self) -> int:
        """The most decimals that a value of a position has."""
        groups = _groups(_root(self.data))
        tags = ("AIPos", "ASPos", "EIPos", "ESPos")
        texts = [text for tag in tags for text in groups.get(tag, {}).values()]
        return max((len(text.partition(".")[2]) for text in texts), default=0)


class TelegramReader:
    """Reads telegrams. The outer element's attributes differ between controllers: they are not looked at.

    A KRC's telegrams differ in their numbers only. The form of one that was read as XML becomes a pattern
    in which numbers alone are free: what fits it is the same XML. All else is read as XML again.

    Args:
        axes: The axes of the robot's joints, in the order of the model.
        programmed: True if the programmed position is read; else telegrams need not have it.
    """

    def __init__(self, axes: Sequence[Axis], *, programmed: bool = True) -> None:
        self._axes = tuple(axes)
        self._tags = (_MEASURED, _PROGRAMMED) if programmed else (_MEASURED,)
        self._scales = tuple(axis.read for axis in axes)
        self._form: re.Pattern[bytes] | None = None
        self._wanted: tuple[int, ...] = ()
        self._held: list[bytes] = []
        self._programmed: Joints = ()

    def read(self, data: bytes) -> Telegram:
        """The telegram in a datagram.

        Raises:
            TelegramError: There is none, or it lacks a position or the Delay.
        """
        found = None if self._form is None else self._form.fullmatch(data)
        if found is None:
            return self._parse(data)
        delay, ipoc, *texts = found.group(*self._wanted)
        measured, held = texts[: len(self._axes)], texts[len(self._axes) :]
        try:
            if held != self._held:  # it hardly ever changes
                self._held, self._programmed = held, self._scaled(held)
            return Telegram(data, int(ipoc), False, int(delay), self._scaled(measured), self._programmed)
        except ValueError:
            return self._parse(data)

    def _scaled(self, texts: Sequence[bytes]) -> Joints:
        return tuple([scale * float(text) for scale, text in zip(self._scales, texts, strict=True)])

    def _parse(self, data: bytes) -> Telegram:
        root = _root(data)
        if root.find("Dat") is not None and root.find("IPOC") is None:
            raise TelegramError("form", f"it holds <Dat>, the form of ERX 1.x on a KRC2, {_NOT_READ}")
        groups = _groups(root)
        text = root.findtext("IPOC", "")
        digits = _DIGITS.fullmatch(text)
        if digits is None:
            raise TelegramError("ipoc", f"IPOC {text[:40]!r}; expected digits")
        ipoc = int(digits[1])
        if not groups:
            return Telegram(data, ipoc, True, 0, (), ())
        q, *rest = (_positions(groups, tags, self._axes) for tags in self._tags)
        programmed = rest[0] if rest else ()
        text = groups.get("Delay", {}).get("D", "")
        delay = _DELAY.fullmatch(text)
        if delay is None:
            said = "is missing" if not text else f"is {text[:40]!r}"
            raise TelegramError("element", f"Delay D {said}: SEND must have DEF_Delay")
        self._learn(data, root)
        return Telegram(data, ipoc, False, int(delay[1]), q, programmed)

    def _learn(self, data: bytes, root: ET.Element) -> None:
        """Learn this telegram's pattern if its text and its XML have the same numbers in the same order."""
        names = [(child.tag, name) for child in (root, *root) for name in child.attrib]
        values = [value.encode() for child in (root, *root) for value in child.attrib.values()]
        numbers = [one for one in zip(names, values, strict=True) if _FREE.fullmatch(b'="' + one[1] + b'"')]
        self._form = None
        if _FREE.findall(data) != [value for _, value in numbers] or len(_IPOC.findall(data)) != 1:
            return
        places = {name: place for place, (name, _) in enumerate(numbers, start=1)}
        positions = ((_tag(axis, *tags), axis.name) for tags in self._tags for axis in self._axes)
        wanted = [("Delay", "D"), *positions]
        if data.index(b"<IPOC>") < data.rindex(b'="') or not places.keys() >= set(wanted):
            return
        delay, *axes = (places[name] for name in wanted)
        self._wanted = (delay, len(numbers) + 1, *axes)
        values = [_VALUE] * len(numbers)
        values[delay - 1] = _DELAY_VALUE
        self._form = _pattern(_FREE.split(_IPOC.sub(b"<IPOC>", data))[::2], values)


def _pattern(texts: Sequence[bytes], values: Sequence[bytes]) -> re.Pattern[bytes]:
    """Return the pattern of a telegram with these texts between its values, and IPOC after the last value."""
    head, _, tail = texts[-1].rpartition(b"<IPOC>")
    groups = [rb'="(' + value + rb')"' for value in values] + [rb"<IPOC>([0-9]{1,20})</IPOC>"]
    pieces = zip((*texts[:-1], head), groups, strict=True)
    return re.compile(b"".join(re.escape(text) + group for text, group in pieces) + re.escape(tail))


def _root(data: bytes) -> ET.Element:
    try:
        root = read_xml(data, LIMIT)
    except XmlError as error:
        raise TelegramError("xml", str(error)) from error
    if root.tag != "Rob":
        raise TelegramError("root", f"the outer element is <{root.tag[:40]}>; expected <Rob>")
    return root


def _groups(root: ET.Element) -> dict[str, dict[str, str]]:
    """The attributes of each element."""
    groups = {child.tag: child.attrib for child in root}
    if len(groups) != len(root):
        raise TelegramError("element", "an element stands twice; expected each once")
    groups.pop("IPOC", None)
    return groups


def _tag(axis: Axis, inner: str, outer: str) -> str:
    return inner if axis.name[0] == "A" else outer


def _positions(groups: dict[str, dict[str, str]], tags: tuple[str, str], axes: Sequence[Axis]) -> Joints:
    found = []
    for axis in axes:
        tag = _tag(axis, *tags)
        text = groups.get(tag, {}).get(axis.name)
        if text is None:
            raise TelegramError("element", f"{tag} {axis.name} is missing: SEND must have DEF_{tag}")
        if not _NUMBER.fullmatch(text) or not math.isfinite(float(text)):
            raise TelegramError("value", f"{tag} {axis.name} is {text[:40]!r}; expected a number")
        found.append(axis.read * float(text))
    return tuple(found)


class ReplyWriter:
    """Writes replies as one KRC's file wants them.

    Elements of axes that are no joint of the robot are zero; all else that the file takes is left to HOLDON.

    Args:
        ethernet: The file.
        axes: The axes of the robot's joints, in the order of the model.
    """

    def __init__(self, ethernet: Ethernet, axes: Sequence[Axis]) -> None:
        groups: dict[str, list[str]] = {}
        for element in ethernet.received:
            if element.attribute in AXES and element.type == "DOUBLE":
                groups.setdefault(element.tag, []).append(element.attribute)
        order = {axis.name: index for index, axis in enumerate(axes)}
        carried = [name for names in groups.values() for name in names]
        self._order = tuple(order[name] for name in carried if name in order)
        body = ""
        for tag, names in groups.items():
            values = ((name, "%.6f" if name in order else "0.000000") for name in names)
            body += f"<{tag}" + "".join(f' {name}="{value}"' for name, value in values) + "/>"
        kind = quoteattr(ethernet.sentype).replace("%", "%%")
        self._form = f"<Sen Type={kind}>{body}<IPOC>%d</IPOC></Sen>"

    def write(self, values: Sequence[float], ipoc: int) -> bytes:
        """A reply.

        Args:
            values: The correction of each axis in the KRC's units.
            ipoc: Of the telegram that it answers.
        """
        return (self._form % (*[values[index] for index in self._order], ipoc)).encode()
