"""Markdown tables and prose of the generated pages."""

import re
from collections.abc import Iterable, Sequence


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Return the lines of a Markdown table."""
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return lines + ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows]


def prose(docstring: str) -> str:
    """Return a docstring as Markdown: code in single backquotes, without Args, Returns and the like."""
    text = re.split(r"^(?:Args|Attributes|Raises|Returns):", docstring, flags=re.MULTILINE)[0]
    return re.sub(r"``([^`]*)``", r"`\1`", text).strip()
