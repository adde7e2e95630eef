"""Picture of the packages and their imports, drawn from the sources: ``python -m tools.packages [--check]``.

Each package is a box in the colour of its folder. A box stands above everything that it imports, so all
arrows point down. An arrow that follows from others is left out. Imports under ``TYPE_CHECKING`` count, too.
"""

import ast
import sys
from collections.abc import Iterable, Iterator
from itertools import pairwise
from pathlib import Path

ROOT = Path(__file__).parents[1]
PICTURE = ROOT / "docs" / "packages.svg"
PORTIONS = {"protocol": "#2f6f9f", "sim": "#5b7f3a", "server": "#9a5a1c", "client": "#7a4a8c"}
"""Folders and the colours of their packages."""

Graph = dict[str, set[str]]
_WIDTH, _HEIGHT, _GAP, _FLOOR = 118, 34, 22, 92


def owners() -> dict[str, str]:
    """Return every package's folder."""
    return {
        path.parent.name: portion
        for portion in PORTIONS
        for path in sorted((ROOT / portion / "armgate").glob("*/__init__.py"))
    }


def imports(packages: dict[str, str]) -> Graph:
    """Return the packages that each package imports."""
    graph: Graph = {name: set() for name in packages}
    for name, portion in packages.items():
        for path in (ROOT / portion / "armgate" / name).rglob("*.py"):
            graph[name] |= {found for found in _imported(path) if found in packages and found != name}
    return graph


def _imported(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        if isinstance(node, ast.ImportFrom) and node.level == 0:
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        for name in names:
            top, _, rest = name.partition(".")
            if top == "armgate":
                yield rest.partition(".")[0]


def reduced(graph: Graph) -> Graph:
    """Return the graph without edges that follow from others.

    Raises:
        ValueError: The imports of packages contain a cycle.
    """
    below = {name: _below(name, graph, (name,)) for name in graph}
    return {
        name: {each for each in direct if not any(each in below[other] for other in direct)}
        for name, direct in graph.items()
    }


def _below(name: str, graph: Graph, way: tuple[str, ...]) -> set[str]:
    found = set(graph[name])
    for each in graph[name]:
        if each in way:
            raise ValueError(f"packages import each other: {' -> '.join((*way, each))}")
        found |= _below(each, graph, (*way, each))
    return found


def floors(graph: Graph) -> list[list[str]]:
    """Return the packages from the lowest floor up; each stands just above the highest that it imports."""
    level: dict[str, int] = {}

    def rise(name: str) -> int:
        if name not in level:
            level[name] = 1 + max((rise(each) for each in graph[name]), default=-1)
        return level[name]

    rows: list[list[str]] = [[] for _ in range(1 + max(map(rise, graph)))]
    for name, at in level.items():
        rows[at].append(name)
    return rows


def _routed(graph: Graph, rows: list[list[str]]) -> dict[tuple[str, str], list[str]]:
    """Reserve a place on each floor that an arrow skips, and return the path of each arrow."""
    level = {name: at for at, row in enumerate(rows) for name in row}
    ways = {}
    for name in sorted(graph):
        for each in sorted(graph[name]):
            skipped = range(level[name] - 1, level[each], -1)
            places = [f"{name}>{each}@{at}" for at in skipped]
            for place, at in zip(places, skipped, strict=True):
                rows[at].append(place)
            ways[name, each] = [name, *places, each]
    return ways


def _order(rows: list[list[str]], ways: Iterable[list[str]]) -> None:
    """Sort each row by the mean place of its neighbours, so that arrows cross little."""
    neighbours: Graph = {name: set() for row in rows for name in row}
    for way in ways:
        for above, below in pairwise(way):
            neighbours[above].add(below)
            neighbours[below].add(above)
    place = {name: (n + 0.5) / len(row) for row in rows for n, name in enumerate(row)}
    for _ in range(8):
        for row in rows:
            mean = {n: sum(place[e] for e in neighbours[n]) / max(len(neighbours[n]), 1) for n in row}
            row.sort(key=lambda name: (mean[name], name))
            place |= {name: (n + 0.5) / len(row) for n, name in enumerate(row)}


def picture() -> str:
    """Return the SVG."""
    packages = owners()
    graph = reduced(imports(packages))
    rows = floors(graph)
    ways = _routed(graph, rows)
    _order(rows, ways.values())
    width = max(len(row) for row in rows) * (_WIDTH + _GAP) + _GAP
    height = len(rows) * _FLOOR + 24
    middles = {
        name: (width * (n + 0.5) / len(row), height - 62.0 - at * _FLOOR)
        for at, row in enumerate(rows)
        for n, name in enumerate(row)
    }
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" '
        'font-family="sans-serif" font-size="14">',
        "<!-- Written by `make pictures` (tools/packages.py) from the imports in the sources. -->",
        f'<rect width="{width}" height="{height}" fill="#ffffff"/>',
        *(_arrow([middles[place] for place in way]) for way in ways.values()),
        *(_box(name, packages[name], *middles[name]) for name in sorted(packages)),
        *_legend(width, height),
        "</svg>",
    ]
    return "\n".join(lines) + "\n"


def _arrow(points: list[tuple[float, float]]) -> str:
    """Return a curve that leaves and enters each floor upright."""
    half = _HEIGHT / 2
    x, y = points[0]
    path = f"M{x:.0f} {y + half:.0f}"
    for (a, top), (b, bottom) in pairwise(points):
        start, end = top + half, bottom - half
        bend = (end - start) / 2
        path += f"C{a:.0f} {start + bend:.0f} {b:.0f} {end - bend:.0f} {b:.0f} {end:.0f}v{2 * half:.0f}"
    path = path.rpartition("v")[0]
    x, y = points[-1]
    return (
        f'<path d="{path}" fill="none" stroke="#8a939c" stroke-width="1.4"/>'
        f'<path d="M{x:.0f} {y - half:.0f}l-4 -8h8z" fill="#8a939c"/>'
    )


def _box(name: str, portion: str, x: float, y: float) -> str:
    return (
        f'<rect x="{x - _WIDTH / 2:.0f}" y="{y - _HEIGHT / 2:.0f}" width="{_WIDTH}" height="{_HEIGHT}" '
        f'rx="5" fill="{PORTIONS[portion]}"/><text x="{x:.0f}" y="{y + 5:.0f}" fill="#ffffff" '
        f'text-anchor="middle">{name}</text>'
    )


def _legend(width: float, height: float) -> Iterator[str]:
    for n, (portion, colour) in enumerate(PORTIONS.items()):
        x = width / 2 + (n - len(PORTIONS) / 2) * 96
        yield f'<rect x="{x:.0f}" y="{height - 24}" width="12" height="12" rx="2" fill="{colour}"/>'
        yield f'<text x="{x + 18:.0f}" y="{height - 13}" fill="#3c4650" font-size="13">{portion}/</text>'


def main(arguments: list[str]) -> int:
    """Write or compare the picture and return the exit status."""
    if arguments not in ([], ["--check"]):
        print(__doc__, file=sys.stderr)
        return 2
    made = picture()
    if PICTURE.exists() and PICTURE.read_text(encoding="utf-8") == made:
        return 0
    if arguments:
        print(f"{PICTURE}: differs from the imports; run: python -m tools.packages", file=sys.stderr)
        return 1
    PICTURE.write_text(made, encoding="utf-8")
    print(PICTURE)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
