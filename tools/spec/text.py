"""Fills the generated blocks of SPEC.md."""

import re
from collections.abc import Callable, Mapping

_BLOCK = re.compile(r"(<!-- begin ([a-z]+) -->\n).*?(<!-- end -->)", re.DOTALL)


def filled(text: str, blocks: Mapping[str, Callable[[], str]]) -> str:
    """The text with every block written anew.

    Raises:
        ValueError: The text has other blocks than ``blocks``, or one twice.
    """
    names = [match[2] for match in _BLOCK.finditer(text)]
    if sorted(names) != sorted(blocks):
        raise ValueError(f"expected the blocks {sorted(blocks)}, each once; the text has {sorted(names)}")
    return _BLOCK.sub(lambda match: f"{match[1]}{blocks[match[2]]()}\n{match[3]}", text)
