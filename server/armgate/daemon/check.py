"""What ``armgate check`` prints: robots, links, joints, pairs, and how clear the start is."""

import math
from collections import Counter

from rich.console import Console
from rich.table import Table
from rich.text import Text

from armgate.cell.cell import Cell, Robot
from armgate.cell.events import Nearest
from armgate.cell.link_config import RsiLinkConfig
from armgate.cell.text import printable
from armgate.daemon.library import Library
from armgate.integrity import start_clearances
from armgate.links.rsi import Setup, setup_of

_SHOWN = 8


def report(cell: Cell, console: Console | None = None) -> int:
    """Print tables about a cell.

    Returns:
        Exit status: 0, or 1 if a robot starts outside its limits or too close to something.

    Raises:
        ConfigError: A robot's KRC cannot be what the cell says it is, or the cell is larger than the protocol
            can describe; the text names file, line and key.
    """
    console = console or Console()
    links = [_rsi(setup_of(cell, one)) for one in cell.robots if isinstance(one.config.link, RsiLinkConfig)]
    Library(cell, lockstep=False)
    nearest = start_clearances(cell)
    console.print(Text(printable(f"cell {cell.name}: {len(cell.robots)} robots, hash {cell.hash[:12]}…")))
    for robot in cell.robots:
        console.print(_joints(robot))
    for line in links:
        console.print(line)
    console.print(_pairs(cell))
    console.print(_clearances(nearest))
    faults = [fault for robot in cell.robots for fault in _outside(robot)] + _too_close(nearest)
    for fault in faults:
        console.print(Text(printable(fault), style="red"))
    if not faults:
        console.print("start: within all limits and distances")
    return 1 if faults else 0


def _rsi(setup: Setup) -> str:
    axes = ", ".join(f"{axis.name} {axis.joint}" for axis in setup.axes)
    host, port = setup.listen
    return f"{setup.robot}: by RSI with the KRC at {setup.krc}, answered at {host}:{port}; axes {axes}"


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


def _pairs(cell: Cell) -> Table:
    counts = Counter((pair.kind, pair.limit) for pair in cell.pairs)
    table = Table("pairs", "count", "kept apart by", title=f"{len(cell.bodies)} bodies")
    for (kind, limit), count in sorted(counts.items()):
        table.add_row(kind, str(count), f"{limit * 1000:g} mm")
    return table


def _clearances(nearest: list[Nearest]) -> Table:
    table = Table("nearest at the start", "distance", "limit", title="clearance")
    for one in nearest[:_SHOWN]:
        table.add_row(
            Text(printable(" – ".join(one.pair))), f"{one.distance * 1000:.1f} mm", f"{one.limit * 1000:g} mm"
        )
    return table


def _outside(robot: Robot) -> list[str]:
    return [
        f"{robot.name}: joint {joint.name} starts at {value:.4f}, outside its limits "
        f"{lower:.4f} to {upper:.4f}"
        for joint, value, lower, upper in zip(
            robot.model.joints, robot.start, robot.lower, robot.upper, strict=True
        )
        if not lower <= value <= upper
    ]


def _too_close(nearest: list[Nearest]) -> list[str]:
    return [
        f"{' – '.join(one.pair)}: {one.distance * 1000:.1f} mm apart at the start; the distance to keep is "
        f"{one.limit * 1000:g} mm"
        for one in nearest
        if one.distance < one.limit
    ]
