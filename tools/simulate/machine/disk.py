"""Simulated disk for recordings: it may be slow, full, or fail, and a power failure tears files.

What is written survives the death of the process. After a power failure, a file holds what was synced and a
random part of the rest.
"""

import errno
import os
import random
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from armgate.recorder.record_file import DiskCalls, RecordFile
from armgate.recording import Header
from armgate.recording.chain import Signer
from tools.simulate.machine.machine import Machine, Process

_AT_ONCE = 64
_BLOCK = 512
_ITEM_NS = 20_000
"""Processor time of the worker per record, ns."""


@dataclass
class File:
    """File on the disk; ``synced`` bytes survive a power failure."""

    path: Path
    data: bytearray = field(default_factory=bytearray)
    synced: int = 0


class Disk:
    """Disk of one machine.

    Args:
        machine: The machine.
        random_: Source of partial writes and torn files.

    Attributes:
        files: Files by path, in the order of their creation.
        room: Bytes that can still be written.
        slow_until: Time until which each write is slow, ns.
        slow_ns: Time of a slow write, ns.
        sync_fails: True if syncing fails.
        write_fails: True if writing fails.
        create_fails: True if no file can be created.
        late_ns: Time that writes have taken and that no process has waited for yet, ns.
    """

    def __init__(self, machine: Machine, random_: random.Random) -> None:
        self._machine, self._random = machine, random_
        self.files: dict[Path, File] = {}
        self.room = 1 << 40
        self.slow_until = self.slow_ns = self.late_ns = 0
        self.sync_fails = self.write_fails = self.create_fails = False
        self._open: dict[int, File] = {}
        self._number = 0
        self._calls = DiskCalls(self._write, self._sync, self._truncate, self._close)

    def create(self, path: Path, header: Header, signer: Signer | None = None) -> RecordFile:
        """Create the file of a recording; the `create` of a recorder."""
        if self.create_fails:
            raise OSError(errno.EMFILE, os.strerror(errno.EMFILE))
        if path in self.files:
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST))
        self._number += 1
        self._open[self._number] = self.files[path] = File(path)
        return RecordFile(path, self._number, header, self._calls, signer)

    def clear(self) -> None:
        """Make room, and let everything succeed at once again."""
        self.heal()
        self.late_ns = 0

    def heal(self) -> None:
        """Make room, and end all faults; writes that are late stay late."""
        self.room, self.slow_until = 1 << 40, 0
        self.sync_fails = self.write_fails = self.create_fails = False

    def power_failure(self) -> None:
        """Keep what was synced, and a random part of the rest, in which a block may be missing."""
        for file in self.files.values():
            kept = self._random.randint(file.synced, len(file.data))
            del file.data[kept:]
            if kept > file.synced and self._random.random() < 0.8:
                self._damage(file.data, self._random.randint(file.synced, kept - 1))
            file.synced = kept

    def _damage(self, data: bytearray, at: int) -> None:
        """Let a block be missing, or one byte be another one."""
        if self._random.random() < 0.3:
            length = min(_BLOCK, len(data) - at)
            data[at : at + length] = bytes(length)
        else:
            data[at] ^= 1 << self._random.randrange(8)

    def _write(self, descriptor: int, data: bytes) -> int:
        if self.write_fails:
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        if self.room <= 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        count = min(len(data), self.room)
        if count > 1 and self._random.random() < 0.05:
            count = self._random.randint(1, count)
        self.room -= count
        self._open[descriptor].data += data[:count]
        if self._machine.now < self.slow_until:
            self.late_ns += self.slow_ns
        return count

    def _sync(self, descriptor: int) -> None:
        if self.sync_fails:
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        file = self._open[descriptor]
        file.synced = len(file.data)

    def _truncate(self, descriptor: int, size: int) -> None:
        del self._open[descriptor].data[size:]

    def _close(self, descriptor: int) -> None:
        del self._open[descriptor]


class SimulatedWorker:
    """`Worker` of a recorder that runs beside the event loop of the process that makes it.

    Args:
        disk: The disk, whose delays it waits for.
        pauses: Does the work.
    """

    def __init__(self, disk: Disk, machine: Machine, pauses: Iterator[float]) -> None:
        assert machine.current is not None
        self._process: Process = machine.current
        self._disk, self._machine, self._pauses = disk, machine, pauses
        self._over = False
        self._run()

    def join(self, timeout: float) -> bool:
        """Work to the end while the process waits; return False if that takes longer than ``timeout``, s."""
        waited = 0
        while not self._over and waited < timeout * 1e9:
            waited += self._work()
        self._process.pause(waited)
        return self._over

    def _run(self) -> None:
        if self._process.alive and not self._over:
            with self._machine.inside(self._process):
                wait = self._work()
            self._machine.after(wait, self._run)

    def _work(self) -> int:
        """Work until the first pause; return the time until the next work, ns."""
        used = 0
        for _ in range(_AT_ONCE):
            pause = next(self._pauses, None)
            used += _ITEM_NS
            if pause is None:
                self._over = True
                break
            if pause or self._disk.late_ns:
                used += round(pause * 1e9)
                break
        used, self._disk.late_ns = used + self._disk.late_ns, 0
        return used
