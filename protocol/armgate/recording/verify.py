"""Verifies the hash chain of a recording: intact, or broken between which bytes and times."""

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Message, Metadata
from pydantic_core import from_json

from armgate.recording import form
from armgate.recording.chain import Seal
from armgate.recording.errors import DamagedError
from armgate.recording.files import open_file
from armgate.recording.reader import Part, Recording
from armgate.recording.scan import PREFIX, Place, records

_NS = 1_000_000_000
_BLOCK = 1 << 20
_SHORT = 1 << 16


@dataclass(frozen=True, slots=True)
class Break:
    """A place at which the chain does not hold.

    Attributes:
        file: The file.
        first: First byte of what is not as it was written.
        end: First byte after it.
        time: Daemon time of its first message, s.
        why: The difference.
    """

    file: Path
    first: int
    end: int
    time: float
    why: str

    def __str__(self) -> str:
        return f"{self.file}: bytes {self.first} to {self.end}, from {self.time:.3f} s on: {self.why}"


@dataclass(frozen=True, slots=True)
class Chain:
    """Result of a verification.

    Attributes:
        links: Number of links and seals that hold.
        breaks: Places at which the chain does not hold.
        unsealed: Files without a seal: they were not closed by a daemon.
        seals: The seals, a file each.
    """

    links: int
    breaks: Sequence[Break]
    unsealed: Sequence[Path]
    seals: Sequence[Seal]

    @property
    def present(self) -> bool:
        """Return True if the recording has a chain; earlier versions of armgate wrote none."""
        return self.links > 0 or bool(self.breaks) or bool(self.seals)


def verify(recording: Recording) -> Chain:
    """Verify the chain through all parts of a recording.

    Raises:
        OSError: A file cannot be read.
    """
    links, breaks, unsealed, seals = 0, [], [], []
    previous: bytes | None = b"" if recording.header.part == 1 else None
    for part in recording.parts:
        checked = _Checked(recording, part)
        breaks += checked.breaks
        links += checked.links
        if previous is not None and part.header.previous != previous.hex():
            breaks.append(checked.broken(0, part.chunks[0].end, part.chunks[0], "follows another part"))
        previous = checked.seal.digest if checked.seal else None
        if checked.seal is None:
            unsealed.append(part.file)
        else:
            seals.append(checked.seal)
    return Chain(links, tuple(breaks), tuple(unsealed), tuple(seals))


class _Checked:
    """One file."""

    def __init__(self, recording: Recording, part: Part) -> None:
        self._part, self._origin = part, recording.header.origin_ns
        self.links, self.breaks = 0, list[Break]()
        self.seal, end = _seal(part)
        before = b""
        with open_file(part.file) as stream:
            for first, last, place, claimed in self._segments(end):
                found = _digest(stream, before, first, last)
                if claimed is None:
                    continue
                if found == claimed:
                    self.links += 1
                else:
                    self.breaks.append(self.broken(first, last, place, "its hash is another"))
                before = claimed

    def broken(self, first: int, end: int, place: Place, why: str) -> Break:
        """Return a break of this file."""
        return Break(self._part.file, first, end, (place.first_ns - self._origin) / _NS, why)

    def _segments(self, end: int) -> Iterator[tuple[int, int, Place, bytes | None]]:
        """Yield begin, end and first chunk of what lies between two links, and the later link."""
        first, chunks = 0, self._part.chunks
        begun = chunks[0]
        linked = False
        for place in chunks[1:]:
            link = self._link(place)
            if link is None:
                continue
            linked = True
            yield first, place.begin, begun, link
            first, begun = place.begin, place
        if self.seal is not None:
            yield first, end, begun, self.seal.digest
            if chunks[-1].begin >= end:
                self.breaks.append(self.broken(end, chunks[-1].end, chunks[-1], "stands behind the seal"))
        elif linked:
            yield first, chunks[-1].end, begun, None

    def _link(self, place: Place) -> bytes | None:
        """Return the link with which a chunk begins; None if it begins with none, or cannot be read."""
        try:
            for record in records(place):
                if isinstance(record, Channel):
                    continue
                if not isinstance(record, Message) or self._part.reader.topic(record) != form.CHAIN:
                    return None
                return bytes.fromhex(from_json(record.data)["sha256"])
        except (DamagedError, ValueError, TypeError, KeyError):
            return None
        return None


def _digest(stream: BinaryIO, before: bytes, first: int, end: int) -> bytes:
    found = hashlib.sha256(before)
    stream.seek(first)
    while first < end and (block := stream.read(min(_BLOCK, end - first))):
        found.update(block)
        first += len(block)
    return found.digest()


def _seal(part: Part) -> tuple[Seal | None, int]:
    """Return the seal and the byte at which it begins; without one, the end of the last chunk."""
    place = part.chunks[-1]
    with open_file(part.file) as stream:
        at = part.chunks[0].end
        size = stream.seek(0, 2)
        while at + PREFIX.size <= size:
            stream.seek(at)
            kind, length = PREFIX.unpack(stream.read(PREFIX.size))
            if kind == Opcode.METADATA and length <= _SHORT and (seal := _read_seal(stream.read(length))):
                return seal, at
            if kind in (0, Opcode.DATA_END):
                break
            at += PREFIX.size + length
    return None, place.end


def _read_seal(content: bytes) -> Seal | None:
    try:
        found = Metadata.read(ReadDataStream(BytesIO(content)))
        return Seal.read(found.metadata) if found.name == form.SEAL else None
    except (McapError, EOFError, ValueError):
        return None
