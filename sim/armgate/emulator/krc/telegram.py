"""The writer of telegrams (``<Rob>``), as the KRC's file orders them."""

from collections.abc import Callable, Mapping
from xml.sax.saxutils import escape

from armgate.emulator.krc.ethernet import ZERO, Element, Ethernet

Groups = Mapping[str, Mapping[str, float]]
"""Values that the KRC fills in: attribute by attribute, by the element's tag; what is not there is zero."""


class TelegramWriter:
    """Writes telegrams: the elements of SEND in the file's order, then Delay if it is one of them, then IPOC.

    Args:
        ethernet: The file.
        precision: Decimals of every DOUBLE; rounding is part of what the PC has to live with.
        root: The outer element's attribute, its name and value: they differ between controllers.
    """

    def __init__(self, ethernet: Ethernet, precision: int, root: tuple[str, str]) -> None:
        self._open = f'<Rob {root[0]}="{root[1]}">'
        self._precision = precision
        groups: dict[str, list[Element]] = {}
        for element in sorted(ethernet.sent, key=lambda element: element.tag == "Delay"):
            groups.setdefault(element.tag, []).append(element)
        self._groups = list(groups.items())
        self.needed = frozenset(groups)
        """Tags that the file asks for."""

    def write(self, values: Groups, ipoc: int) -> bytes:
        """A telegram."""
        inner = "".join(self._group(tag, elements, values.get(tag, {}).get) for tag, elements in self._groups)
        return f"{self._open}{inner}<IPOC>{ipoc}</IPOC></Rob>".encode()

    def short(self, ipoc: int) -> bytes:
        """The frame with which RSI 2 begins: nothing but the IPOC."""
        return f"{self._open}<IPOC>{ipoc}</IPOC></Rob>".encode()

    def _group(self, tag: str, elements: list[Element], value: Callable[[str], float | None]) -> str:
        texts = [(element.attribute, self._text(element, value(element.attribute))) for element in elements]
        attributes = "".join(f' {name}="{text}"' for name, text in texts if name)
        # A file may declare a tag's text beside its attributes.
        content = "".join(escape(text) for name, text in texts if not name)
        return (
            f"<{tag}{attributes}/>"
            if all(name for name, _ in texts)
            else f"<{tag}{attributes}>{content}</{tag}>"
        )

    def _text(self, element: Element, value: float | None) -> str:
        given = ZERO[element.type] if value is None else value
        if element.type == "DOUBLE":
            return f"{given:.{self._precision}f}"
        return str(given) if element.type == "STRING" else str(int(given))
