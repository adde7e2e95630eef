"""Escaping of texts that come from clients and files, before they are shown on a terminal."""

import unicodedata

_HIDDEN = ("Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp")
"""Unicode categories that control a terminal, reorder or hide text, or end a line."""


def printable(text: object) -> str:
    r"""Return a text in one line, with control characters and other invisible characters escaped.

    A terminal executes control characters, and directional characters reorder the text around them.
    The text ESC ``[2J`` becomes the seven visible characters ``\x1b[2J``, and a line break becomes ``\n``.
    """
    given = str(text)
    if given.isascii() and given.isprintable():
        return given
    return "".join(_escape(character) for character in given)


def printable_lines(text: object) -> str:
    """Return a text of several lines with each line made `printable`."""
    return "\n".join(map(printable, str(text).split("\n")))


def _escape(character: str) -> str:
    if unicodedata.category(character) not in _HIDDEN:
        return character
    return character.encode("unicode_escape", errors="surrogatepass").decode()
