"""The telegrams of RSI: reads what a KRC sends (``<Rob>``), writes what it takes (``<Sen>``)."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from xml.sax.saxutils import quoteattr

from armgate.links.rsi.axes import AXES, Axis
from armgate.links.rsi.ethernet import Ethernet
from armgate.links.rsi.xml import XmlError, read_xml

LIMIT = 4096
"""Longest telegram that is read, bytes: one with everything that RSI can send has less than half of it."""
LONGEST_REPLY = 1024
"""More a KRC does not take, bytes."""
_DIGITS = re.compile(r"\s*([0-9]{1,20})\s*")
_DELAY = re.compile(r"[0-9]{1,10}")
_NUMBER = r"[-+]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]{1,2})?"
_NUMBERS = re.compile(rf"{_NUMBER}(?: {_NUMBER})*")


class TelegramError(Exception):
    """A datagram is no telegram of a KRC; says why.

    Attributes:
        kind: A word for counting: ``xml``, ``root``, ``ipoc``, ``element``, ``value``.
    """

    def __init__(self, kind: str, text: str) -> None:
        super().__init__(text)
        self.kind = kind


@dataclass(frozen=True, slots=True)
class Telegram:
    """What a KRC said.

    Attributes:
        ipoc: Its number.
        groups: The attributes of each element, by its name.
    """

    ipoc: int
    groups: dict[str, dict[str, str]]

    @property
    def short(self) -> bool:
        """Whether it is RSI 2's first frame: nothing but the IPOC."""
        return not self.groups

    @property
    def delay(self) -> int:
        """How many cycles were late so far.

        Raises:
            TelegramError: It is not said.
        """
        text = self.groups.get("Delay", {}).get("D", "")
        if not _DELAY.fullmatch(text):
            said = "is missing" if not text else f"is {text[:40]!r}"
            raise TelegramError("element", f"Delay D {said}: SEND must have DEF_Delay")
        return int(text)

    def values(self, inner: str, outer: str, axes: Sequence[Axis]) -> tuple[float, ...]:
        """The positions of the axes' joints, rad or m, in the order of ``axes``.

        Args:
            inner: The element with A1…: AIPos or ASPos.
            outer: The element with E1…: EIPos or ESPos.
            axes: Which.

        Raises:
            TelegramError: A value is missing or no number.
        """
        groups = {"A": self.groups.get(inner, {}), "E": self.groups.get(outer, {})}
        texts = [groups[axis.name[0]].get(axis.name, "-") for axis in axes]
        if not _NUMBERS.fullmatch(" ".join(texts)):
            raise self._bad_value(inner, outer, axes, texts)
        return tuple([axis.read * float(text) for axis, text in zip(axes, texts, strict=True)])

    def _bad_value(self, inner: str, outer: str, axes: Sequence[Axis], texts: list[str]) -> TelegramError:
        for axis, text in zip(axes, texts, strict=True):
            tag = inner if axis.name[0] == "A" else outer
            if text == "-":
                return TelegramError("element", f"{tag} {axis.name} is missing: SEND must have DEF_{tag}")
            if not _NUMBERS.fullmatch(text) or " " in text:
                return TelegramError("value", f"{tag} {axis.name} is {text[:40]!r}; expected a number")
        return TelegramError("value", f"{inner} or {outer} holds no numbers")

    def decimals(self, *tags: str) -> int:
        """The most decimals that a value of these elements has."""
        texts = [text for tag in tags for text in self.groups.get(tag, {}).values()]
        return max((len(text.partition(".")[2]) for text in texts), default=0)


def read_telegram(data: bytes) -> Telegram:
    """The telegram in a datagram. The outer element's attributes differ between controllers: not looked at.

    Raises:
        TelegramError: There is none.
    """
    try:
        root = read_xml(data, LIMIT)
    except XmlError as error:
        raise TelegramError("xml", str(error)) from error
    if root.tag != "Rob":
        raise TelegramError("root", f"the outer element is <{root.tag[:40]}>; expected <Rob>")
    groups = {child.tag: child.attrib for child in root}
    if len(groups) != len(root):
        raise TelegramError("element", "an element stands twice; expected each once")
    groups.pop("IPOC", None)
    text = root.findtext("IPOC", "")
    digits = _DIGITS.fullmatch(text)
    if digits is None:
        raise TelegramError("ipoc", f"IPOC {text[:40]!r}; expected digits")
    return Telegram(int(digits[1]), groups)


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
