"""Check of the events of a recording against its cell, before the gate processes them."""

import math
from collections.abc import Sequence
from typing import assert_never

from armgate.cell.cell import Cell
from armgate.events import (
    Command,
    GateEvent,
    LeaseChange,
    LinkChange,
    PlanAnswer,
    Reset,
    Stop,
    Tick,
)

_MOST = 1 << 53


def event_error(cell: Cell, event: GateEvent) -> str | None:
    """Return the reason why an event is impossible for this cell; None if it is possible."""
    named = () if isinstance(event, Reset) else event.robots if isinstance(event, Stop) else (event.robot,)
    return _unknown_robot(cell, named) or _number_error(cell, event)


def _number_error(cell: Cell, event: GateEvent) -> str | None:
    match event:
        case Tick():
            found = _tick_error(cell, event)
        case Command():
            found = _range_error(event.seq, event.based_on, event.fence)
        case PlanAnswer():
            found = _range_error(event.key.resets, event.key.target)
        case LeaseChange():
            found = _range_error(event.fence or 0) or _share_error(event.speed)
        case Reset():
            found = _range_error(event.stop)
        case LinkChange() | Stop():
            found = None
        case _:
            assert_never(event)
    return found


def _unknown_robot(cell: Cell, names: Sequence[str]) -> str | None:
    known = {robot.name for robot in cell.robots}
    return next((f"there is no robot {name[:60]!r}" for name in names if name not in known), None)


def _tick_error(cell: Cell, event: Tick) -> str | None:
    n = cell.robot(event.robot).model.n
    for name in ("q", "setpoint", "increment"):
        values = getattr(event, name)
        if len(values) != n or not all(map(math.isfinite, values)):
            return f"{name}: expected {n} numbers"
    return _range_error(event.tick, event.index) or (
        None if math.isfinite(event.time) else "time: expected a number"
    )


def _range_error(*numbers: int) -> str | None:
    return next((f"{number} is out of range" for number in numbers if abs(number) > _MOST), None)


def _share_error(speed: float) -> str | None:
    return None if 0.0 <= speed <= 1.0 else f"speed {speed}: expected 0 to 1"
