"""Verification of the hash chain of a recording; reports the bytes and times of each break."""

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

from armgate.recording.chain import Seal
from armgate.recording.errors import DamagedError
from armgate.recording.files import open_file
from armgate.recording.header import END, SEAL, end_record
from armgate.recording.reader import Part, Recording
from armgate.recording.scan import PREFIX, ChunkPosition, records
from armgate.recording.topics import CHAIN

_NS = 1_000_000_000
_BLOCK = 1 << 20
_SHORT = 1 << 16
_LAST = {end_record(last)["last"]: last for last in (True, False)}


@dataclass(frozen=True, slots=True)
class Break:
    """Break of the chain.

    Attributes:
        file: The file.
        first: First byte of the range that was changed.
        end: First byte after the range.
        time: Daemon time of the range's first message, s.
        why: Reason: the difference that was found.
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
        links: Number of valid links and seals.
        breaks: Breaks of the chain.
        unsealed: Files without a seal: they were not closed by a daemon.
        seals: Seals, one for each sealed file.
        parts: Numbers of the first and the last part.
        last: True if the last part states that it ends the recording, False if it states that another part
            follows; None if it states neither, because a daemon of an earlier version closed it.
    """

    links: int
    breaks: Sequence[Break]
    unsealed: Sequence[Path]
    seals: Sequence[Seal]
    parts: tuple[int, int]
    last: bool | None

    @property
    def present(self) -> bool:
        """True if the recording has a chain; earlier versions of armgate wrote none."""
        return self.links > 0 or bool(self.breaks) or bool(self.seals)


def verify(recording: Recording) -> Chain:
    """Verify the chain through all parts of a recording; a folder must hold all parts.

    Raises:
        OSError: A file cannot be read.
    """
    links, breaks, unsealed, seals = 0, [], [], []
    previous: bytes | None = b"" if recording.header.part == 1 else None
    for part in recording.parts:
        checked = _FileChain(recording, part)
        breaks += checked.breaks
        links += checked.links
        if previous is not None and part.header.previous != previous.hex():
            breaks.append(
                checked.broken(0, part.chunks[0].end, part.chunks[0], "does not continue the previous part")
            )
        previous = checked.seal.digest if checked.seal else None
        if checked.seal is None:
            unsealed.append(part.file)
        else:
            seals.append(checked.seal)
    if recording.path.is_dir():
        breaks += _missing(recording, checked)
    numbers = recording.header.part, recording.parts[-1].header.part
    return Chain(links, tuple(breaks), tuple(unsealed), tuple(seals), numbers, checked.last)


def _missing(recording: Recording, last: "_FileChain") -> Iterator[Break]:
    """Yield a break for each end of the recording at which parts were removed."""
    first, end = recording.parts[0], recording.parts[-1]
    if (number := first.header.part) != 1:
        yield Break(first.file, 0, 0, 0.0, f"begins with part {number}; part {number - 1} is missing")
    if last.last is False:
        size, number = end.chunks[-1].end, end.header.part
        time = (end.chunks[-1].last_ns - recording.header.origin_ns) / _NS
        yield Break(
            end.file, size, size, time, f"part {number + 1} is missing; this part is not the last one"
        )


class _FileChain:
    """Verified chain of one file."""

    def __init__(self, recording: Recording, part: Part) -> None:
        self._part, self._origin = part, recording.header.origin_ns
        self.links, self.breaks = 0, list[Break]()
        self.seal, self.last, end = _tail(part)
        before = b""
        with open_file(part.file) as stream:
            for first, last, place, claimed in self._segments(end):
                found = _digest(stream, before, first, last)
                if claimed is None:
                    continue
                if found == claimed:
                    self.links += 1
                else:
                    self.breaks.append(self.broken(first, last, place, "its hash differs"))
                before = claimed

    def broken(self, first: int, end: int, place: ChunkPosition, why: str) -> Break:
        """Return a break in this file."""
        return Break(self._part.file, first, end, (place.first_ns - self._origin) / _NS, why)

    def _segments(self, end: int) -> Iterator[tuple[int, int, ChunkPosition, bytes | None]]:
        """Yield begin, end and first chunk of each segment between two links, and the later link."""
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
                self.breaks.append(self.broken(end, chunks[-1].end, chunks[-1], "was added after the seal"))
        elif linked:
            yield first, chunks[-1].end, begun, None

    def _link(self, place: ChunkPosition) -> bytes | None:
        """Return the link at the start of a chunk; None if there is none or the chunk cannot be read."""
        try:
            for record in records(place):
                if isinstance(record, Channel):
                    continue
                if not isinstance(record, Message) or self._part.reader.topic(record) != CHAIN:
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


def _tail(part: Part) -> tuple[Seal | None, bool | None, int]:
    """Return the seal, the value of the ``END`` record before it, and the byte at which the seal begins.

    Without a seal, return the end of the last chunk as the byte.
    """
    place, last = part.chunks[-1], None
    with open_file(part.file) as stream:
        at = part.chunks[0].end
        size = stream.seek(0, 2)
        while at + PREFIX.size <= size:
            stream.seek(at)
            kind, length = PREFIX.unpack(stream.read(PREFIX.size))
            found = _metadata(stream.read(length)) if kind == Opcode.METADATA and length <= _SHORT else None
            if found is not None and (seal := _read_seal(found)):
                return seal, last, at
            if found is not None and found.name == END:
                last = _LAST.get(found.metadata.get("last", ""))
            if kind in (0, Opcode.DATA_END):
                break
            at += PREFIX.size + length
    return None, None, place.end


def _metadata(content: bytes) -> Metadata | None:
    try:
        return Metadata.read(ReadDataStream(BytesIO(content)))
    except (McapError, EOFError, ValueError):
        return None


def _read_seal(found: Metadata) -> Seal | None:
    try:
        return Seal.read(found.metadata) if found.name == SEAL else None
    except ValueError:
        return None
