"""Recorders of a world: they receive its events, the gate's outputs, and the states."""

from collections.abc import Callable, Sequence
from typing import Protocol

from armgate.cell.cell import Cell
from armgate.events import GateEvent, GateOutput
from armgate.world.states import Snapshot


class RunRecorder(Protocol):
    """Recorder of one run in a world."""

    def begin(self, cell: Cell, start: str, now: Callable[[], float], compiled: bool | None) -> None:
        """Begin the recording, before the first event.

        Args:
            cell: The cell.
            start: Start id that plans carry.
            now: Virtual time, s.
            compiled: Form of the gate's kernels, as for `Gate`.
        """

    def tap(self, event: GateEvent, outputs: Sequence[GateOutput]) -> None:
        """Record an event and the gate's outputs."""

    def show(self, snapshot: Snapshot) -> None:
        """Record the states of an instant."""


class RunRecorders:
    """Recorders of one world. A saved world has none: two runs must not write to the same recording.

    Args:
        recorders: The recorders.
    """

    def __init__(self, recorders: Sequence[RunRecorder] = ()) -> None:
        self._recorders = tuple(recorders)

    def __bool__(self) -> bool:
        """Return True if there is a recorder."""
        return bool(self._recorders)

    def begin(self, cell: Cell, start: str, now: Callable[[], float], compiled: bool | None) -> None:
        """Begin all recordings."""
        for recorder in self._recorders:
            recorder.begin(cell, start, now, compiled)

    def tap(self, event: GateEvent, outputs: list[GateOutput]) -> None:
        """Record an event and the gate's outputs."""
        for recorder in self._recorders:
            recorder.tap(event, outputs)

    def show(self, snapshot: Snapshot) -> None:
        """Record the states of an instant."""
        for recorder in self._recorders:
            recorder.show(snapshot)

    def __reduce__(self) -> tuple[type["RunRecorders"], tuple[()]]:
        """Return the constructor without recorders, for copies."""
        return RunRecorders, ()
