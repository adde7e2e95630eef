"""Files of one recording: when a file has reached its size, the next one begins."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from armgate.events import Tick
from armgate.protocol import messages as m
from armgate.recorder.record_file import RecordFile
from armgate.recording import CellState, Header, Item, RobotState, part_name
from armgate.recording.chain import Seal, Signer
from armgate.world.states import Snapshot

ROTATE = 1 << 28
"""Default size of a file after which the next file begins, bytes."""


@dataclass(frozen=True, slots=True)
class StateAt:
    """States of an instant, which are turned into records when they are written."""

    ticks: Sequence[Tick]
    entries: Sequence[m.Entry]
    cell: CellState

    def items(self) -> list[Item]:
        """Return its records."""
        own = {entry.robot: entry for entry in self.entries}
        return [*(RobotState(own[tick.robot]) for tick in self.ticks), self.cell]


def state_at(snapshot: Snapshot) -> StateAt | None:
    """Return the states of a snapshot; None if no robot ticked, so that there is nothing to record."""
    ticks = snapshot.ticks
    if not ticks:
        return None
    by_robot = {tick.robot: tick.tick for tick in ticks}
    cell = CellState(ticks[0].time, snapshot.step, by_robot, snapshot.signals, snapshot.warnings)
    return StateAt(ticks, snapshot.entries, cell)


class Parts:
    """Files of one recording; `begin` creates the first.

    Args:
        folder: Folder of the files; created if it does not exist.
        rotate: Size of a file after which the next file begins, bytes.
        signer: Signs each file when it is closed; None: files are not signed.
        create: Creates a file, from its path, header and signer.

    Attributes:
        folder: Folder of the files.
        seal: End of the hash chain of the file that was closed last.
    """

    def __init__(
        self,
        folder: Path,
        rotate: int = ROTATE,
        signer: Signer | None = None,
        create: Callable[[Path, Header, Signer | None], RecordFile] = RecordFile.create,
    ) -> None:
        self.folder = folder
        self.seal: Seal | None = None
        self._rotate = rotate
        self._signer = signer
        self._create = create
        self._part: RecordFile

    @property
    def path(self) -> Path:
        """Path of the current file."""
        return self._part.path

    def begin(self, header: Header) -> None:
        """Create the first file.

        Raises:
            OSError: The folder or the file cannot be created.
        """
        self.folder.mkdir(parents=True, exist_ok=True)
        self._part = self._open(header)

    def put(self, at: float, item: Item | StateAt) -> None:
        """Add an item of daemon time ``at``, s.

        Raises:
            OSError: It cannot be written.
        """
        for record in item.items() if isinstance(item, StateAt) else (item,):
            self._part.put(record, at)

    def flush(self) -> None:
        """Write all items so far to the operating system; begin the next file if this one has its size.

        Raises:
            OSError: They cannot be written.
        """
        self._part.flush()
        if self._part.size >= self._rotate:
            previous, header = self._close(last=False).digest.hex(), self._part.header
            self._part = self._open(header.model_copy(update={"part": header.part + 1, "previous": previous}))

    def close(self) -> None:
        """Complete the last file.

        Raises:
            OSError: It cannot be written; some file systems report a full disk only here.
        """
        self._close(last=True)

    def abandon(self) -> None:
        """Truncate the current file after the last complete flush, and stop writing."""
        self._part.abandon()

    def _close(self, *, last: bool) -> Seal:
        self.seal = self._part.close(last=last)
        return self.seal

    def _open(self, header: Header) -> RecordFile:
        return self._create(self.folder / part_name(header.part), header, self._signer)
