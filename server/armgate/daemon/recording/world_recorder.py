"""Recorder of a world (`armgate.world`): writes each record at once, without thread and event loop."""

from collections.abc import Callable, Sequence
from pathlib import Path

from armgate.cell.cell import Cell
from armgate.daemon.recording.recorder import Recorder, StateAt
from armgate.daemon.recording.start import header_of
from armgate.events import GateEvent, GateOutput
from armgate.recording import Item
from armgate.recording.chain import Signer
from armgate.world.states import Snapshot

_FLUSH = 4096
"""Number of records between two flushes."""


class SynchronousRecorder(Recorder):
    """`Recorder` that writes in the call that records; a failure of the disk raises an `OSError` there."""

    _unflushed = 0

    def close(self, timeout: float = 10.0) -> None:
        """Close the file; ``timeout`` is not used."""
        if self._begun:
            self._begun = False
            self._close_part()

    def _start(self) -> None:
        """Start nothing."""

    def _put(self, at: float, item: Item | StateAt) -> None:
        self._put_into_file(at, item)
        self._unflushed += 1
        if self._unflushed >= _FLUSH:
            self._unflushed = 0
            self._flush_part()


class WorldRecorder:
    """Recorder of one world; a `RunRecorder`, and a context manager that closes the recording.

    Args:
        folder: Folder of the files; created if it does not exist.
        rotate: Size of a file after which the next file begins, bytes.
        signer: Signs each file when it is closed; None: files are not signed.
    """

    def __init__(self, folder: Path, *, rotate: int = 1 << 28, signer: Signer | None = None) -> None:
        self._recorder = SynchronousRecorder(folder, rotate=rotate, signer=signer)

    def begin(self, cell: Cell, start: str, now: Callable[[], float], compiled: bool | None) -> None:
        """Create the first file.

        Raises:
            OSError: The folder or the file cannot be created.
        """
        self._recorder.begin(header_of(cell, start, True, now(), compiled), now)

    def tap(self, event: GateEvent, outputs: Sequence[GateOutput]) -> None:
        """Record an event and the gate's outputs.

        Raises:
            OSError: The record cannot be written.
        """
        self._recorder.tap(event, outputs)

    def show(self, snapshot: Snapshot) -> None:
        """Record the states of an instant.

        Raises:
            OSError: The records cannot be written.
        """
        self._recorder.show(snapshot)

    def close(self) -> None:
        """Close the recording."""
        self._recorder.close()

    def __enter__(self) -> "WorldRecorder":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
