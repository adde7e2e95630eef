"""Recorder of a world (`armgate.world`): writes in the call that records, without thread and event loop."""

from collections.abc import Callable, Sequence
from pathlib import Path

from armgate.cell.cell import Cell
from armgate.events import GateEvent, GateOutput
from armgate.recorder.header import header_of
from armgate.recorder.parts import ROTATE, Parts, StateAt, state_at
from armgate.recording import Item, Step
from armgate.recording.chain import Signer
from armgate.world.states import Snapshot

_FLUSH = 4096
"""Number of records between two flushes."""


class WorldRecorder:
    """Recorder of one world; a `RunRecorder`, and a context manager that closes the recording.

    Args:
        folder: Folder of the files; created if it does not exist.
        rotate: Size of a file after which the next file begins, bytes.
        signer: Signs each file when it is closed; None: files are not signed.
    """

    def __init__(self, folder: Path, *, rotate: int = ROTATE, signer: Signer | None = None) -> None:
        self._parts = Parts(folder, rotate, signer)
        self._now: Callable[[], float]
        self._begun = False
        self._unflushed = 0

    def begin(self, cell: Cell, start: str, now: Callable[[], float], compiled: bool | None) -> None:
        """Create the first file.

        Raises:
            OSError: The folder or the file cannot be created.
        """
        self._now = now
        self._parts.begin(header_of(cell, start, True, now(), compiled))
        self._begun = True

    def tap(self, event: GateEvent, outputs: Sequence[GateOutput]) -> None:
        """Record an event and the gate's outputs.

        Raises:
            OSError: The record cannot be written.
            ValueError: The recording is closed.
        """
        self._put(self._now(), Step(event, outputs))

    def show(self, snapshot: Snapshot) -> None:
        """Record the states of an instant.

        Raises:
            OSError: The records cannot be written.
            ValueError: The recording is closed.
        """
        state = state_at(snapshot)
        if state is not None:
            self._put(state.cell.time, state)

    def close(self) -> None:
        """Close the recording; closing it again has no effect.

        Raises:
            OSError: The last records cannot be written.
        """
        if self._begun:
            self._begun = False
            self._parts.close()

    def _put(self, at: float, item: Item | StateAt) -> None:
        if not self._begun:
            raise ValueError("the recording is closed; close it after the last step of its world")
        self._parts.put(at, item)
        self._unflushed += 1
        if self._unflushed >= _FLUSH:
            self._unflushed = 0
            self._parts.flush()

    def __enter__(self) -> "WorldRecorder":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
