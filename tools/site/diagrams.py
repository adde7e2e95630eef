"""Diagrams of the pages, drawn as SVG from the text that forges draw by Mermaid.

The site loads nothing from the network, and Mermaid is a large program, so the three kinds that the pages use
are drawn here: sequences of messages, state machines and flows. All are drawn as columns and rows: a column
for each participant, state or node, a row for each message, transition or edge, an arrow from column to
column. So no layout has to be searched for, and arrows do not cross each other.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from html import escape

_BLOCK = re.compile(r"^```mermaid\n(.*?)^```[ \t]*$", re.MULTILINE | re.DOTALL)
_MESSAGE = re.compile(r"(\w+)\s*-?->>\s*(\w+)\s*:\s*(.*)")
_PARTICIPANT = re.compile(r"(?:participant|actor)\s+(\w+)(?:\s+as\s+(.*))?")
_TRANSITION = re.compile(r"(\[\*\]|\w+)\s*-->\s*(\[\*\]|\w+)\s*(?::\s*(.*))?")
_EDGE = re.compile(r"(\w+)(?:\[([^\]]*)\])?\s*(<?-->)(?:\|([^|]*)\|)?\s*(\w+)(?:\[([^\]]*)\])?")
_ENTRY = "[*]"
_ROW, _HEAD, _MARGIN, _CHARACTER = 34, 40, 14, 6.7
"""Heights of a row and of the boxes above, margin, and width of a character, px."""


@dataclass(frozen=True)
class Arrow:
    """Message, transition or edge; ``both`` if it has a head at each end."""

    start: str
    end: str
    label: str
    both: bool = False


@dataclass(frozen=True)
class Frame:
    """Label of rows that are repeated or optional, at the row where they begin or end."""

    label: str


@dataclass(frozen=True)
class Diagram:
    """Columns by key with their titles, and rows from top to bottom; a frame without label ends one."""

    columns: dict[str, str]
    rows: tuple[Arrow | Frame, ...]


class DiagramError(ValueError):
    """Diagram with a line that this module cannot draw."""


def drawn(markdown: str) -> str:
    """Return a page whose Mermaid blocks are replaced by SVG."""
    begin, end = '<div class="diagram" data-search-exclude>', "</div>"
    return _BLOCK.sub(lambda match: begin + svg(parsed(match[1])) + end, markdown)


def parsed(text: str) -> Diagram:
    """Return the diagram that a Mermaid text describes.

    Raises:
        DiagramError: It is of another kind, or has a line that is not known.
    """
    kind, *lines = [line.strip() for line in text.strip().splitlines()]
    if kind == "sequenceDiagram":
        return _sequence(lines)
    if kind.startswith("stateDiagram"):
        return _states(lines)
    if kind.startswith("flowchart"):
        return _flow(lines)
    raise DiagramError(f"{kind!r}: expected sequenceDiagram, stateDiagram-v2 or flowchart")


def _sequence(lines: list[str]) -> Diagram:
    columns: dict[str, str] = {}
    rows: list[Arrow | Frame] = []
    for line in lines:
        if match := _PARTICIPANT.fullmatch(line):
            columns[match[1]] = match[2] or match[1]
        elif match := _MESSAGE.fullmatch(line):
            for key in (match[1], match[2]):
                columns.setdefault(key, key)
            rows.append(Arrow(match[1], match[2], match[3]))
        elif match := re.fullmatch(r"(?:loop|opt)\s+(.*)", line):
            rows.append(Frame(match[1]))
        elif line == "end":
            rows.append(Frame(""))
        elif line:
            raise DiagramError(f"{line!r}: expected a participant, a message, loop, opt or end")
    return Diagram(columns, tuple(rows))


def _states(lines: list[str]) -> Diagram:
    columns: dict[str, str] = {}
    arrows: list[Arrow] = []
    for line in filter(None, lines):
        match = _TRANSITION.fullmatch(line)
        if match is None:
            raise DiagramError(f"{line!r}: expected a transition, such as a --> b: label")
        for state in (match[1], match[2]):
            if state != _ENTRY:
                columns.setdefault(state, state)
        arrows.append(Arrow(match[1], match[2], match[3] or ("start" if match[1] == _ENTRY else "end")))
    for arrow in arrows:
        if arrow.end == _ENTRY:
            columns[arrow.start] = columns.pop(arrow.start)
    return Diagram(columns, tuple(arrows))


def _flow(lines: list[str]) -> Diagram:
    columns: dict[str, str] = {}
    arrows: list[Arrow] = []
    for line in filter(None, lines):
        match = _EDGE.fullmatch(line)
        if match is None:
            raise DiagramError(f"{line!r}: expected an edge, such as A[text] -->|label| B[text]")
        for key, title in ((match[1], match[2]), (match[5], match[6])):
            if title or key not in columns:
                columns[key] = title or key
        arrows.append(Arrow(match[1], match[5], match[4] or "", both=match[3].startswith("<")))
    return Diagram(columns, tuple(arrows))


def svg(diagram: Diagram) -> str:
    """Return a diagram as an SVG without blank lines, in the colours of the text around it."""
    places = _places(diagram)
    width = max(places.values()) + _column_width(list(diagram.columns.values())[-1]) / 2 + _MARGIN
    rows = [row for row in diagram.rows if row != Frame("")]
    height = _HEAD + _ROW * len(rows) + _MARGIN
    body = [*_columns(diagram, places, height), *_rows(diagram, places, width)]
    return (
        f'<svg class="diagram" xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}" '
        f'width="{width:.0f}" role="img" font-size="12" fill="currentColor">' + "".join(body) + "</svg>"
    )


def _column_width(title: str) -> float:
    return max(70.0, 7.4 * len(title) + 20.0)


def _places(diagram: Diagram) -> dict[str, float]:
    """Return the middle of each column: boxes and the labels between neighbours fit."""
    arrows = [row for row in diagram.rows if isinstance(row, Arrow)]
    entered = any(_ENTRY in {arrow.start, arrow.end} for arrow in arrows)
    places = {_ENTRY: _MARGIN + 6.0}
    before, x = "", _MARGIN + (60.0 if entered else 0.0)
    for key, title in diagram.columns.items():
        half = _column_width(title) / 2
        apart = _column_width(diagram.columns[before]) / 2 + 12.0 + half if before else half
        x += max(apart, _room(arrows, before, key)) if before else half
        places[key] = x
        before = key
    return places


def _room(arrows: list[Arrow], left: str, right: str) -> float:
    """Return the distance that labels between two neighbours need."""
    between = [arrow.label for arrow in arrows if {arrow.start, arrow.end} == {left, right}]
    return _CHARACTER * max(map(len, between), default=0) + 30.0


def _columns(diagram: Diagram, places: dict[str, float], height: float) -> Iterator[str]:
    for key, title in diagram.columns.items():
        x, half = places[key], _column_width(title) / 2
        yield f'<path d="M{x:.0f} {_HEAD - 8}V{height - 4:.0f}" stroke="currentColor" opacity=".25"/>'
        yield (
            f'<rect x="{x - half:.0f}" y="6" width="{2 * half:.0f}" height="26" rx="5" fill="none" '
            'stroke="currentColor"/>'
        )
        yield f'<text x="{x:.0f}" y="23" text-anchor="middle" font-weight="600">{escape(title)}</text>'


def _rows(diagram: Diagram, places: dict[str, float], width: float) -> Iterator[str]:
    y = float(_HEAD)
    frames: list[tuple[str, float]] = []
    for row in diagram.rows:
        if isinstance(row, Arrow):
            y += _ROW
            yield from _arrow(row, places, y - 10.0)
        elif row.label:
            y += _ROW
            frames.append((row.label, y - _ROW + 8.0))
        else:
            yield from _frame(*frames.pop(), y, width)


def _frame(label: str, top: float, bottom: float, width: float) -> Iterator[str]:
    yield (
        f'<rect x="3" y="{top:.0f}" width="{width - 6:.0f}" height="{bottom - top + 2:.0f}" rx="4" '
        'fill="none" stroke="currentColor" stroke-dasharray="4 3" opacity=".6"/>'
    )
    yield f'<text x="10" y="{top + 15:.0f}" font-style="italic">{escape(label)}</text>'


def _arrow(arrow: Arrow, places: dict[str, float], y: float) -> Iterator[str]:
    a, b = places[arrow.start], places[arrow.end]
    label = escape(arrow.label)
    if arrow.start == arrow.end:
        path = f"M{a:.0f} {y - 10:.0f}h14v10h-14"
        yield f'<path d="{path}" fill="none" stroke="currentColor"/>{_head(a, y, -1)}'
        yield f'<text x="{a + 20:.0f}" y="{y - 2:.0f}">{label}</text>'
        return
    way = 1 if b > a else -1
    if arrow.start == _ENTRY:
        yield f'<circle cx="{a:.0f}" cy="{y:.0f}" r="5"/>'
    if arrow.end == _ENTRY:
        yield f'<circle cx="{b:.0f}" cy="{y:.0f}" r="5" fill="none" stroke="currentColor" stroke-width="2"/>'
        b -= 5 * way
    back = _head(a, y, -way) if arrow.both else ""
    yield f'<path d="M{a:.0f} {y:.0f}H{b:.0f}" stroke="currentColor"/>{_head(b, y, way)}{back}'
    middle = (a + b) / 2
    yield (
        f'<text x="{middle:.0f}" y="{y - 5:.0f}" text-anchor="middle" paint-order="stroke" '
        f'class="label">{label}</text>'
    )


def _head(x: float, y: float, way: int) -> str:
    return f'<path d="M{x:.0f} {y:.0f}l{-8 * way} -4v8z"/>'
