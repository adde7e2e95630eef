"""Texts of others, made safe to show: names, reasons and signals come from clients and from files."""

import unicodedata

_HIDDEN = ("Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp")
"""Categories of Unicode that control a terminal, reorder or hide text, or end a line."""


def printable(text: object) -> str:
    r"""Return a text in one line, in which control characters and other invisible ones are escaped.

    A terminal obeys control characters, and characters for the direction of text reorder what surrounds them:
    ``\x1b[2J`` becomes the six visible characters ``\\x1b[2J``, and a line break becomes ``\\n``.
    """
    given = str(text)
    if given.isascii() and given.isprintable():
        return given
    return "".join(_escaped(character) for character in given)


def printable_lines(text: object) -> str:
    """Return a text of several lines, each of which is `printable`."""
    return "\n".join(map(printable, str(text).split("\n")))


def _escaped(character: str) -> str:
    if unicodedata.category(character) not in _HIDDEN:
        return character
    return character.encode("unicode_escape", errors="surrogatepass").decode()
