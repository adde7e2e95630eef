"""Report of ``armgate check``: robots, links, joints, pairs, warnings, and clearances at the start."""

import math
from collections import Counter

from rich.console import Console
from rich.table import Table
from rich.text import Text

from armgate.cell.cell import Cell, Robot
from armgate.cell.cell_warnings import cell_warnings
from armgate.cell.terminal_text import printable
from armgate.events import Nearest
from armgate.gate import start_clearances
from armgate.links.kind import check_links
from armgate.world.description import CellDescription

_SHOWN = 8
_FAULTS = 64

REMEDY = (
    "the gate admits only motion away from these; change start or base, lower stop_distance or "
    "self_distance, or list pairs that touch by construction in ignore_pairs"
)


def report(cell: Cell, console: Console | None = None) -> int:
    """Print a report about a cell.

    Returns:
        Exit status: 0, or 1 if a robot starts outside its limits or below a distance to keep.

    Raises:
        ConfigError: A robot's link cannot be made as configured, or the cell is larger than the protocol can
            describe; the text names file, line and key.
    """
    console = console or Console()
    links = check_links(cell)
    CellDescription(cell, lockstep=False)
    nearest = start_clearances(cell)

    def write(text: str, style: str = "") -> None:
        console.print(Text(printable(text), style=style), soft_wrap=True)

    robots = "robot" if len(cell.robots) == 1 else "robots"
    write(f"cell {cell.name}: {len(cell.robots)} {robots}, hash {cell.hash[:12]}…")
    for robot in cell.robots:
        console.print(_joints(robot))
        write(_lags(robot))
    for name, link in links.items():
        for line in link.lines:
            write(f"{name}: {line}")
        for warning in link.warnings:
            write(f"{name}: warning: {warning}", style="yellow")
    console.print(_pairs(cell))
    console.print(_clearances(nearest))
    for text in cell_warnings(cell):
        write(f"warning: {text}", style="yellow")
    faults = start_faults(cell, nearest)
    for fault in faults[:_FAULTS]:
        write(fault, style="red")
    if len(faults) > _FAULTS:
        write(f"… and {len(faults) - _FAULTS} more", style="red")
    if faults:
        write(REMEDY, style="red")
    else:
        write("start: within all limits and distances")
    return 1 if faults else 0


def start_faults(cell: Cell, nearest: list[Nearest]) -> list[str]:
    """Return a line for each joint that starts outside its limits and each pair that is too close."""
    return [fault for robot in cell.robots for fault in _outside(robot)] + _too_close(nearest)


def _lags(robot: Robot) -> str:
    """Return a line about the lag that the gate assumes for a robot."""
    low, high = (f"{1000.0 * lag:g}" for lag in (min(robot.lags), max(robot.lags)))
    lag = low if low == high else f"{low} to {high}"
    differ = f"axes differ by at most {1000.0 * robot.lag_difference:g} ms"
    return f"{robot.name}: lags {lag} ms, {differ}; delay at most {1000.0 * robot.lag_window:g} ms"


def _joints(robot: Robot) -> Table:
    title = Text(f"{robot.name}: {robot.model.n} joints, period {robot.period * 1000:g} ms")
    table = Table("joint", "kind", "lower", "upper", "speed /s", "acc. /s²", "dec. /s²", "start", title=title)
    for index, joint in enumerate(robot.model.joints):
        columns = (
            robot.lower, robot.upper, robot.velocity, robot.acceleration, robot.deceleration, robot.start,
        )  # fmt: skip
        shown = [_quantity(float(values[index]), joint.kind) for values in columns]
        table.add_row(Text(printable(joint.name)), joint.kind, *shown)
    return table


def _quantity(value: float, kind: str) -> str:
    if math.isinf(value):
        return "no bound"
    return f"{math.degrees(value):.1f}°" if kind == "revolute" else f"{value * 1000:.0f} mm"


def _apart(distance: float, word: str) -> str:
    mm = round(distance * 1000, 1)
    return f"overlap of {-mm:.1f} mm" if mm < 0.0 else f"{mm + 0.0:.1f} mm{word}"


def _pairs(cell: Cell) -> Table:
    counts = Counter((pair.kind, pair.limit) for pair in cell.pairs)
    table = Table("pairs", "count", "distance to keep", title=f"{len(cell.bodies)} bodies")
    for (kind, limit), count in sorted(counts.items()):
        table.add_row(kind, str(count), f"{limit * 1000:g} mm")
    return table


def _clearances(nearest: list[Nearest]) -> Table:
    table = Table("nearest at the start", "distance", "limit", title="clearance")
    for one in nearest[:_SHOWN]:
        table.add_row(
            Text(printable(" – ".join(one.pair))), _apart(one.distance, ""), f"{one.limit * 1000:g} mm"
        )
    return table


def _outside(robot: Robot) -> list[str]:
    return [
        f"{robot.name}: joint {joint.name} starts at {_quantity(value, joint.kind)}, outside its limits "
        f"{_quantity(lower, joint.kind)} to {_quantity(upper, joint.kind)}"
        for joint, value, lower, upper in zip(
            robot.model.joints, robot.start, robot.lower, robot.upper, strict=True
        )
        if not lower <= value <= upper
    ]


def _too_close(nearest: list[Nearest]) -> list[str]:
    return [
        f"{' – '.join(one.pair)}: {_apart(one.distance, ' apart')} at the start; the "
        f"distance to keep is {one.limit * 1000:g} mm"
        for one in nearest
        if one.distance < one.limit
    ]
