"""Scan of one file for complete chunks; the file may be damaged or still be written.

An MCAP record begins with its kind and its length, so a file can be read forward without its index. The index
is written only when a file is closed, which a killed daemon never does.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Header, Message, Metadata, Schema

from armgate.recording.chunk import ChunkError, read_chunk
from armgate.recording.errors import DamagedError, ForeignError, NewerFormatError
from armgate.recording.files import open_file
from armgate.recording.header import FORMAT, METADATA, PROFILE

MAGIC = b"\x89MCAP0\r\n"
PREFIX = struct.Struct("<BQ")
_TIMES = struct.Struct("<QQ")
_LARGEST = 1 << 29
"""Longest accepted record, bytes."""
_SHORT = 1 << 16
"""Longest accepted header or metadata record, bytes."""
_PRIVATE = 0x80
"""First record kind that MCAP leaves to applications; lower kinds belong to the standard."""


@dataclass(frozen=True, slots=True)
class ChunkPosition:
    """Position of a chunk in a file.

    Attributes:
        file: The file.
        offset: First byte of the chunk's content.
        length: Length of the content, bytes.
        first_ns: Time of its first message by the chunk's header, ns since 1970.
        last_ns: Time of its last message by the chunk's header, ns since 1970.
    """

    file: Path
    offset: int
    length: int
    first_ns: int
    last_ns: int

    @property
    def begin(self) -> int:
        """First byte of the chunk's record."""
        return self.offset - PREFIX.size

    @property
    def end(self) -> int:
        """First byte after the chunk."""
        return self.offset + self.length


@dataclass(frozen=True, slots=True)
class Scan:
    """Readable content of a file, up to the first damaged byte.

    Attributes:
        file: The file.
        chunks: Its complete chunks, in order.
        good: Number of bytes up to the end of the last complete record.
        size: Size of the file, bytes.
        closed: True if the file was closed: its index and end marker are complete.
    """

    file: Path
    chunks: tuple[ChunkPosition, ...]
    good: int
    size: int
    closed: bool


def scan(file: Path) -> Scan:
    """Scan a file without reading the content of chunks.

    Raises:
        OSError: The file cannot be read.
        ForeignError: The file is not a recording of armgate.
        NewerFormatError: The file was written by a later version of armgate.
        DamagedError: The file is damaged at its beginning.
    """
    with open_file(file) as stream:
        size = stream.seek(0, 2)
        stream.seek(0)
        start = stream.read(len(MAGIC))
        if start != MAGIC:
            if not MAGIC.startswith(start):
                raise ForeignError(file, "not MCAP; expected a recording of armgate")
            return Scan(file, (), 0, size, closed=False)
        chunks, good, closed = _walk(file, stream, len(MAGIC), size)
    return Scan(file, tuple(chunks), good, size, closed and good == size)


def scan_from(file: Path, offset: int) -> tuple[ChunkPosition, ...]:
    """Return the readable chunks of the consecutive records that begin at ``offset``.

    Raises:
        OSError: The file cannot be read.
    """
    with open_file(file) as stream:
        size = stream.seek(0, 2)
        stream.seek(offset)
        return tuple(_walk(file, stream, offset, size)[0])


def _walk(file: Path, stream: BinaryIO, good: int, size: int) -> tuple[list[ChunkPosition], int, bool]:
    """Return the chunks of consecutive records, the end of the last one, and True if the file ends there."""
    chunks: list[ChunkPosition] = []
    while (record := _prefix(stream.read(PREFIX.size))) is not None:
        kind, length = record
        content = good + PREFIX.size
        if not _plausible(kind) or length > _LARGEST or content + length > size:
            break
        if kind in (Opcode.HEADER, Opcode.METADATA) and not chunks:
            if length > _SHORT:
                raise DamagedError(file, f"damaged at byte {good}: a header of {length} bytes")
            _check(file, kind, stream.read(length))
        elif kind == Opcode.CHUNK:
            if length < _TIMES.size:
                break
            first, last = _TIMES.unpack(stream.read(_TIMES.size))
            chunks.append(ChunkPosition(file, content, length, first, last))
        good = content + length
        stream.seek(good)
        if kind == Opcode.FOOTER and stream.read(len(MAGIC)) == MAGIC:
            return chunks, good + len(MAGIC), True
        stream.seek(good)
    return chunks, good, False


def _plausible(kind: int) -> bool:
    return Opcode.HEADER <= kind <= Opcode.DATA_END or kind >= _PRIVATE


def _prefix(data: bytes) -> tuple[int, int] | None:
    if len(data) < PREFIX.size:
        return None
    kind, length = PREFIX.unpack(data)
    return kind, length


def _check(file: Path, kind: int, content: bytes) -> None:
    """Refuse a file of another program or of a later format."""
    stream = ReadDataStream(BytesIO(content))
    try:
        if kind == Opcode.HEADER:
            profile = Header.read(stream).profile
            if profile != PROFILE:
                text = f"MCAP with the profile {profile[:40]!r}; expected a recording of armgate"
                raise ForeignError(file, text)
            return
        metadata = Metadata.read(stream)
        written = int(metadata.metadata.get("format", "0")) if metadata.name == METADATA else 0
    except (McapError, ValueError, struct.error, EOFError) as error:
        raise DamagedError(file, f"damaged at its beginning: {error or type(error).__name__}") from error
    if written > FORMAT:
        text = f"written in format {written}; this version reads up to {FORMAT}; use a later version"
        raise NewerFormatError(file, text)


class ChunkReader:
    """Reader of a file's chunks; the first chunk names the topics of all.

    Args:
        place: Position of the first chunk.

    Raises:
        DamagedError: The first chunk is damaged.
    """

    def __init__(self, place: ChunkPosition) -> None:
        self._topics: dict[int, str] = {}
        for _ in self.messages(place):
            pass

    def topic(self, message: Message) -> str:
        """Return the topic of a message; "" if its channel is unknown."""
        return self._topics.get(message.channel_id, "")

    def messages(self, place: ChunkPosition) -> Iterator[tuple[str, int, bytes]]:
        """Yield topic, log time [ns] and data of every message of a chunk.

        Raises:
            DamagedError: The chunk is damaged.
        """
        for record in records(place):
            if isinstance(record, Channel):
                self._topics[record.id] = record.topic
            elif isinstance(record, Message):
                yield self.topic(record), record.log_time, record.data


def records(place: ChunkPosition) -> Iterator[Schema | Channel | Message]:
    """Yield all records of a chunk: schemas, channels and messages.

    Raises:
        DamagedError: The chunk is damaged.
    """
    with open_file(place.file) as stream:
        stream.seek(place.offset)
        content = stream.read(place.length)
    try:
        yield from read_chunk(content)
    except ChunkError as error:
        text = f"damaged at byte {place.offset}: {error}; restore it from a copy, or run: armgate recover"
        raise DamagedError(place.file, f"{text} {place.file}") from error
