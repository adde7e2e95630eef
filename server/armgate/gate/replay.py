"""Replay: the same events give the same outputs, so a log of events is a recording of every decision."""

from collections.abc import Iterable, Iterator

from armgate.cell.cell import build_cell
from armgate.cell.config import CellConfig
from armgate.events import GateEvent, GateOutput
from armgate.gate.gate import Gate


def replay(config: CellConfig, events: Iterable[GateEvent], start: str) -> Iterator[list[GateOutput]]:
    """Judges every event again and yields the outputs, event by event, identical to those of the run.

    Args:
        config: The configuration of the run.
        events: Its events in order.
        start: The daemon's start id of the run.
    """
    gate = Gate(build_cell(config), start)
    for event in events:
        yield gate.step(event)
