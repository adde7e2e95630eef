"""What was checked and found, as lines and as JSON."""

from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

from armgate.monitor.core import Account
from armgate.monitor.model import KINDS, Cell

LISTED = 20
_WORDS = {"robots": "between robots", "surroundings": "to the surroundings", "self": "within a robot"}


def printable(text: str) -> str:
    """Return a text in one line: names come from files and from clients."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def beginning(cell: Cell) -> str:
    """Return the line that says what is watched."""
    robots = ", ".join(robot.name for robot in cell.robots)
    return f"watching {robots}: {len(cell.bodies)} bodies, {len(cell.pairs)} pairs"


def summary(account: Account) -> str:
    """Return the account in one line."""
    missed = sum(account.missed.values())
    words = [f"{account.states} states, {account.positions} positions checked"]
    words += [f"never seen: {' '.join(account.unseen)}"] if account.unseen else []
    words += [f"{missed} states missed"] if missed else []
    words += [f"{account.late} states judged late"] if account.late else []
    words += [f"{account.retreats} margins violated at the start"] if account.retreats else []
    words += [f"{account.violations or 'no'} violation{'' if account.violations == 1 else 's'}"]
    return ", ".join(words)


def lines(account: Account) -> Iterator[str]:
    """Yield the account: findings, smallest clearances, and the summary last."""
    yield from (f"violated: {finding}" for finding in account.findings[:LISTED])
    if account.violations > LISTED:
        yield f"… and {account.violations - LISTED} more"
    for kind in KINDS:
        if (found := account.smallest.get(kind)) is not None:
            a, b = found.pair
            yield (
                f"smallest clearance {_WORDS[kind]}: {1e3 * found.distance:.3f} mm "
                f"({1e3 * found.limit:g} mm required), {a} – {b}, "
                f"{found.robot} tick {found.tick} ({found.time:.3f} s)"
            )
    yield summary(account)


def as_json(account: Account) -> dict[str, Any]:
    """Return the account as JSON has it."""
    found = asdict(account)
    found["smallest"] = list(found["smallest"].values())
    found["summary"] = summary(account)
    return found
