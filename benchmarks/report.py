"""Report of a benchmark as a table and a JSON file: case, value, unit, goal, and if it holds."""

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table

OUT = Path(__file__).parent / "out"


@dataclass(frozen=True)
class Row:
    """Figure with its goal: an upper bound, or a lower bound if ``at_least``; None if it has no goal."""

    case: str
    value: float
    unit: str
    goal: float | None = None
    at_least: bool = False

    @property
    def holds(self) -> bool | None:
        if self.goal is None:
            return None
        return self.value >= self.goal if self.at_least else self.value <= self.goal


def report(name: str, rows: Iterable[Row]) -> None:
    """Print the table and write ``benchmarks/out/NAME.json``; a missed goal is reported, not an error."""
    rows = list(rows)
    table = Table(title=f"bench {name}")
    for column in ("case", "value", "unit", "goal", "holds"):
        table.add_column(column, justify="left" if column in ("case", "unit") else "right")
    for row in rows:
        goal = "" if row.goal is None else f"{'≥' if row.at_least else '≤'} {row.goal:g}"
        holds = {True: "yes", False: "NO", None: ""}[row.holds]
        table.add_row(row.case, f"{row.value:.4g}", row.unit, goal, holds)
    Console().print(table)
    OUT.mkdir(exist_ok=True)
    data = {"rows": [{**asdict(row), "holds": row.holds} for row in rows]}
    path = OUT / f"{name}.json"
    path.write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
    print(f"written: {path.relative_to(OUT.parent.parent)}")
