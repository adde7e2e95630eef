"""Vocabulary of a KRC's RSI Ethernet file: anything else is rejected by name, nothing is dropped silently."""

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable

_CHILDREN: dict[str, tuple[str, ...]] = {
    "ROOT": ("CONFIG", "SEND", "RECEIVE"),
    "CONFIG": (
        "IP_NUMBER", "PORT", "SENTYPE", "ONLYSEND", "PROTOCOL", "PROTOCOLLENGTH", "PROTCOLLENGTH",
        "INTERFACE",
    ),
    "SEND": ("ELEMENTS",),
    "RECEIVE": ("ELEMENTS",),
    "ELEMENTS": ("ELEMENT",),
}  # fmt: skip
"""Elements in each element; a KRC2's INTERFACE and the length of its protocol (for TCP) are ignored."""

_ATTRIBUTES = {"ELEMENT": ("TAG", "TYPE", "INDX", "HOLDON", "UNIT")}
_ENCODING = re.compile(r"""<\?xml\s[^>]*?encoding\s*=\s*["']([^"']*)["']""")
_UTF_8 = re.compile(r"utf-?8|us-ascii", re.IGNORECASE)
_LATIN = re.compile(r"iso-8859-\d{1,2}|windows-125\d", re.IGNORECASE)
"""Encodings that contain ASCII."""


def vocabulary_objection(element: ET.Element, path: str = "") -> str | None:
    """Return an objection to the first item that is not in the vocabulary, None if there is none."""
    tag, where = element.tag, f"{path}<{element.tag}>"
    known = _CHILDREN.get(tag, ())
    odd = _unknown(element.attrib, _ATTRIBUTES.get(tag, ()))
    if odd is not None:
        return f"{where}: the attribute {odd!r} is not known; expected {_listed(_ATTRIBUTES.get(tag, ()))}"
    texts = [child.tail for child in element] + ([element.text] if known or tag == "ELEMENT" else [])
    if any((text or "").strip() for text in texts):
        return f"{where}: text between elements; expected {_listed(known)}: remove it or make it a comment"
    seen = set()
    for child in element:
        if child.tag not in known:
            return f"{where}: <{child.tag}> is not known; expected {_listed(known)}"
        if child.tag in seen and child.tag != "ELEMENT":
            return f"{where}: <{child.tag}> occurs again; expected it once"
        seen.add(child.tag)
        objection = vocabulary_objection(child, where)
        if objection is not None:
            return objection
    return None


def _unknown(attributes: Iterable[str], known: Iterable[str]) -> str | None:
    """Return the first unknown attribute; attributes of other namespaces, such as a schema's, are allowed."""
    return next((name for name in attributes if name not in known and name[:1] != "{"), None)


def _listed(names: Iterable[str]) -> str:
    return ", ".join(names) or "none"


def encoding_objection(text: str) -> str | None:
    """Return an objection if the KRC would read another text in the declared encoding, else None."""
    declared = _ENCODING.match(text)
    if declared is None or _UTF_8.fullmatch(declared[1]):
        return None
    if _LATIN.fullmatch(declared[1]) and text.isascii():
        return None
    return f"the file declares the encoding {declared[1]!r} but is UTF-8; declare UTF-8"
