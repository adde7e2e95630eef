"""Finding of the lint of English."""

from typing import NamedTuple


class Finding(NamedTuple):
    """Place in a file that has to be rewritten."""

    line: int
    """1 for the first line."""
    kind: str
    """``docstring``, ``idiom``, ``name`` or ``long sentence``."""
    text: str
    """Quotation and hint."""
