"""Search of Python sources: openings of docstrings, idioms in prose, names of functions."""

import ast
import io
import re
import tokenize
from collections.abc import Iterator

from tools.words.finding import Finding
from tools.words.idioms import idioms, riddle

OPENINGS = ("Whether", "Who", "Whom", "Whose", "What", "Where", "How", "That", "As", "Which", "Why")
"""Words that begin a bare clause; a docstring begins with a verb, or with a noun phrase."""
_OPENING = re.compile(rf"\W*({'|'.join(OPENINGS)})\b")
_SPAN = re.compile(r"``[^`]*``|`[^`]*`")
_TEXTS = {tokenize.STRING, getattr(tokenize, "FSTRING_MIDDLE", tokenize.STRING)}


def python_findings(source: str) -> Iterator[Finding]:
    """Yield the findings in the source of a module."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            yield from _openings(node.body)
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            part = riddle(re.sub(r"(?<=[a-z])(?=[A-Z])", "_", node.name))
            if part:
                yield Finding(node.lineno, "name", f"“{part}” in {node.name}: use the field's term")
    yield from _idioms(source)


def _openings(body: list[ast.stmt]) -> Iterator[Finding]:
    """Yield docstrings, of attributes too, that begin with a bare clause."""
    for statement in body:
        if isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant):
            text = statement.value.value
            if isinstance(text, str) and (match := _OPENING.match(text)):
                first = text.strip().splitlines()[0]
                yield Finding(statement.lineno, "docstring", f"begins with “{match[1]}”: {first[:80]}")


def _idioms(source: str) -> Iterator[Finding]:
    """Yield idioms in comments and in texts of more than one word; code in backquotes is left out."""
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        prose = token.type == tokenize.COMMENT or (token.type in _TEXTS and " " in token.string.strip())
        if not prose:
            continue
        text = _SPAN.sub(lambda match: re.sub(r"[^\n]", "_", match[0]), token.string)
        for offset, description in idioms(text):
            yield Finding(token.start[0] + text.count("\n", 0, offset), "idiom", description)
