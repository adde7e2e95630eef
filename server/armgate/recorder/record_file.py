"""File of a recording, which stays readable if its disk becomes full."""

import contextlib
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from armgate.recording import Header, Item, RecordingWriter
from armgate.recording.chain import Seal, Signer


@dataclass(frozen=True, slots=True)
class DiskCalls:
    """System calls by which a file is written, each on its descriptor; a simulation replaces them.

    Attributes:
        write: Writes bytes, and returns the number of those written.
        sync: Waits until the file is on the disk.
        truncate: Shortens the file to a size, bytes.
        close: Closes the descriptor.
    """

    write: Callable[[int, bytes], int] = os.write
    sync: Callable[[int], None] = os.fsync
    truncate: Callable[[int, int], None] = os.ftruncate
    close: Callable[[int], None] = os.close


_SYSTEM = DiskCalls()


class _Stream:
    """Unbuffered stream: flushed bytes are in the operating system, even if this process is killed."""

    def __init__(self, descriptor: int, disk: DiskCalls) -> None:
        self._descriptor = descriptor
        self._disk = disk
        self._at = 0
        self._kept = bytearray()

    def write(self, data: bytes, /) -> int:
        """Keep the bytes until ``flush``, so that a chunk and its indexes are one system call."""
        self._kept += data
        return len(data)

    def tell(self) -> int:
        """Return the number of bytes written or kept."""
        return self._at + len(self._kept)

    def flush(self) -> None:
        """Write the bytes that are kept.

        Raises:
            OSError: They cannot be written.
        """
        while self._kept:
            done = self._disk.write(self._descriptor, bytes(self._kept))
            self._at += done
            del self._kept[:done]


class RecordFile:
    """File that is being written; made by `RecordFile.create`.

    Attributes:
        path: Its path.
        header: Header at its beginning.
    """

    def __init__(
        self,
        path: Path,
        descriptor: int,
        header: Header,
        disk: DiskCalls = _SYSTEM,
        signer: Signer | None = None,
    ) -> None:
        self.path = path
        self.header = header
        self._descriptor, self._disk = descriptor, disk
        self._good = 0
        try:
            self._sink = RecordingWriter(_Stream(descriptor, disk), header, signer)
        except OSError:
            self.abandon()
            raise
        self._good = self._sink.size

    @classmethod
    def create(cls, path: Path, header: Header, signer: Signer | None = None) -> "RecordFile":
        """Create the file; ``signer`` signs its seal.

        Raises:
            OSError: It exists, or cannot be written.
        """
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC
        return cls(path, os.open(path, flags, 0o644), header, signer=signer)

    @property
    def size(self) -> int:
        """Size of the file so far, bytes."""
        return self._sink.size

    def put(self, item: Item, at: float) -> None:
        """Add an item of daemon time ``at``, s.

        Raises:
            OSError: It cannot be written.
        """
        self._sink.put(item, at)

    def flush(self) -> None:
        """Write all items so far to the operating system.

        Raises:
            OSError: It cannot be written.
        """
        self._sink.flush()
        self._good = self._sink.size

    def close(self, *, last: bool = True) -> Seal:
        """Complete the file; return the end of its hash chain.

        Args:
            last: False if another part follows.

        Raises:
            OSError: It cannot be written; some file systems report a full disk only here.
        """
        self.flush()
        seal = self._sink.close(last=last)
        self._disk.sync(self._descriptor)
        descriptor, self._descriptor = self._descriptor, -1
        self._disk.close(descriptor)
        return seal

    def abandon(self) -> None:
        """Truncate the file after the last complete flush, and stop writing."""
        if self._descriptor >= 0:
            with contextlib.suppress(OSError):
                self._disk.truncate(self._descriptor, self._good)
            self._release()

    def _release(self) -> None:
        # Close it only once: the system may have given the number to another file.
        descriptor, self._descriptor = self._descriptor, -1
        with contextlib.suppress(OSError):
            self._disk.close(descriptor)
