"""Search of Markdown: idioms, and sentences that are too long."""

import re
from collections.abc import Iterator

from tools.words.finding import Finding
from tools.words.idioms import idioms

LONGEST = 40
"""Words of a sentence."""
_FENCED = re.compile(r"^([ \t]*)(```|~~~).*?^[ \t]*\2[ \t]*$|<!--.*?-->", re.MULTILINE | re.DOTALL)
_CODE = re.compile(r"`[^`\n]+`")
_LINK = re.compile(r"!?\[([^\]]*)\]\([^)]*\)")
_BLOCK = re.compile(r"\s*(?:[-*+] |\d+\. |#{1,6} |> |\||$)")
_ITEM = re.compile(r"\s*(?:[-*+] |\d+\. )")
_END = re.compile(r"(?<!e\.g)(?<!i\.e)(?<!cf)(?<!vs)(?<!\bal)[.!?][)\"*_”]*(?=\s|$)")
_WORD = re.compile(r"\w")


def markdown_findings(text: str) -> Iterator[Finding]:
    """Yield the findings in a Markdown file. Code is left out; a cell of a table is a text of its own."""
    prose = _FENCED.sub(lambda match: "\n" * match[0].count("\n"), text)
    for line, block in _blocks(prose):
        plain = _LINK.sub(r"\1", _CODE.sub("code", block))
        yield from (Finding(line, "idiom", description) for _, description in idioms(plain))
        for sentence in _END.split(plain):
            words = [word for word in sentence.split() if _WORD.search(word)]
            if len(words) > LONGEST:
                yield Finding(line, "long sentence", f"{len(words)} words: {' '.join(words[:8])} …")


def _blocks(text: str) -> Iterator[tuple[int, str]]:
    """Yield paragraphs, items, headings and cells, each with its first line's number."""
    start, lines = 1, list[str]()
    for number, line in enumerate(text.split("\n"), 1):
        if _BLOCK.match(line):
            yield start, " ".join(lines)
            lines = []
        code = line.startswith("    ") and not lines and not _ITEM.match(line)
        if line.lstrip().startswith("|"):
            yield from ((number, cell.strip()) for cell in line.split("|"))
        elif line.strip() and not code:
            start = start if lines else number
            lines.append(line.strip())
    yield start, " ".join(lines)
