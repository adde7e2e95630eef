"""Report of the monitor, as lines and as JSON."""

from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

from armgate.monitor.findings import Summary
from armgate.monitor.model import KINDS, Cell

LISTED = 20
_WORDS = {"robots": "between robots", "surroundings": "to the surroundings", "self": "within a robot"}


def printable(text: str) -> str:
    """Return a text as one printable line: names come from files and from clients."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def first_line(cell: Cell) -> str:
    """Return the line that is printed at the start: robots, bodies and pairs."""
    robots = ", ".join(robot.name for robot in cell.robots)
    return f"watching {robots}: {len(cell.bodies)} bodies, {len(cell.pairs)} pairs"


def summary_line(summary: Summary) -> str:
    """Return the summary as one line."""
    missed = sum(summary.missed.values())
    words = [f"{summary.states} states, {summary.positions} positions checked"]
    words += [f"no state received: {' '.join(summary.unseen)}"] if summary.unseen else []
    words += [f"{missed} states missed"] if missed else []
    words += [f"{summary.late} states checked late"] if summary.late else []
    words += [f"{summary.retreats} margins violated at the start"] if summary.retreats else []
    words += [f"{summary.violations or 'no'} violation{'' if summary.violations == 1 else 's'}"]
    return ", ".join(words)


def lines(summary: Summary) -> Iterator[str]:
    """Yield the lines of the report: findings, smallest clearances, and the summary last."""
    yield from (f"violated: {finding}" for finding in summary.findings[:LISTED])
    if summary.violations > LISTED:
        yield f"… and {summary.violations - LISTED} more"
    for kind in KINDS:
        if (found := summary.smallest.get(kind)) is not None:
            a, b = found.pair
            yield (
                f"smallest clearance {_WORDS[kind]}: {1e3 * found.distance:.3f} mm "
                f"({1e3 * found.limit:g} mm required), {a} – {b}, "
                f"{found.robot} tick {found.tick} ({found.time:.3f} s)"
            )
    yield summary_line(summary)


def as_json(summary: Summary) -> dict[str, Any]:
    """Return the summary as a value for JSON."""
    found = asdict(summary)
    found["smallest"] = list(found["smallest"].values())
    found["summary"] = summary_line(summary)
    return found
