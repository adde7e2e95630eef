"""Finds what is whole in one file, which may be damaged or still be written.

A record of MCAP begins with its kind and its length, so a file is read forward without its index: an index is
only written when a file is closed, and a killed daemon closes none.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Header, Message, Metadata

from armgate.recording import form
from armgate.recording.chunk import ChunkError, read_chunk
from armgate.recording.errors import DamagedError, ForeignError, NewerFormatError
from armgate.recording.files import open_file

MAGIC = b"\x89MCAP0\r\n"
PREFIX = struct.Struct("<BQ")
_TIMES = struct.Struct("<QQ")
_LARGEST = 1 << 29
"""Longest record that is read, bytes."""
_SHORT = 1 << 16
"""Longest header and metadata record, bytes."""
_PRIVATE = 0x80
"""Kinds from here on are free for additions; the others are named by the standard."""


@dataclass(frozen=True, slots=True)
class Place:
    """A chunk in a file.

    Attributes:
        file: The file.
        offset: First byte of the chunk's content.
        length: Bytes of it.
        first_ns: Time of its first message, ns since 1970, as its header says.
        last_ns: Time of its last message.
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
    """Contents of a file up to the first byte that cannot be read.

    Attributes:
        file: The file.
        chunks: Its whole chunks, in order.
        good: Bytes up to the end of the last whole record.
        size: All bytes.
        closed: True if the file was closed: it ends as a whole file does.
    """

    file: Path
    chunks: tuple[Place, ...]
    good: int
    size: int
    closed: bool


def scan(file: Path) -> Scan:
    """Look through a file, without reading the content of chunks.

    Raises:
        OSError: It cannot be read.
        ForeignError: It is no recording of armgate.
        NewerFormatError: It was written by a later armgate.
        DamagedError: It is damaged at its beginning.
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


def scan_from(file: Path, offset: int) -> tuple[Place, ...]:
    """Return the chunks that can be read from the first record after ``offset`` on, if records follow.

    Raises:
        OSError: The file cannot be read.
    """
    with open_file(file) as stream:
        size = stream.seek(0, 2)
        stream.seek(offset)
        return tuple(_walk(file, stream, offset, size)[0])


def _walk(file: Path, stream: BinaryIO, good: int, size: int) -> tuple[list[Place], int, bool]:
    """Return the chunks of the records that follow each other, the end of the last, True if it is the end."""
    chunks: list[Place] = []
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
            chunks.append(Place(file, content, length, first, last))
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
    """Refuse a file that is not ours, or of a form that this armgate does not know."""
    stream = ReadDataStream(BytesIO(content))
    try:
        if kind == Opcode.HEADER:
            profile = Header.read(stream).profile
            if profile != form.PROFILE:
                text = f"MCAP of the profile {profile[:40]!r}; expected a recording of armgate"
                raise ForeignError(file, text)
            return
        metadata = Metadata.read(stream)
        written = int(metadata.metadata.get("format", "0")) if metadata.name == form.METADATA else 0
    except (McapError, ValueError, struct.error, EOFError) as error:
        raise DamagedError(file, f"damaged at its beginning: {error or type(error).__name__}") from error
    if written > form.FORMAT:
        text = f"written in format {written}, this armgate reads up to {form.FORMAT}; use a later armgate"
        raise NewerFormatError(file, text)


Message_ = tuple[str, int, bytes]
"""Topic, log time [ns] and data."""


class Chunks:
    """Reads a file's chunks; the first one names the topics of all.

    Args:
        place: The first chunk.

    Raises:
        DamagedError: It is not what was written.
    """

    def __init__(self, place: Place) -> None:
        self._topics: dict[int, str] = {}
        for _ in self.messages(place):
            pass

    def topic(self, message: Message) -> str:
        """Return the topic of a message; "" if it has none."""
        return self._topics.get(message.channel_id, "")

    def messages(self, place: Place) -> Iterator[Message_]:
        """Yield topic, log time [ns] and data of every message of a chunk.

        Raises:
            DamagedError: The chunk is not what was written.
        """
        for record in records(place):
            if isinstance(record, Channel):
                self._topics[record.id] = record.topic
            elif isinstance(record, Message):
                yield self.topic(record), record.log_time, record.data


def records(place: Place) -> Iterator[Any]:
    """Yield all records of a chunk: schemas, channels and messages.

    Raises:
        DamagedError: The chunk is not what was written.
    """
    with open_file(place.file) as stream:
        stream.seek(place.offset)
        content = stream.read(place.length)
    try:
        yield from read_chunk(content)
    except ChunkError as error:
        text = f"damaged at byte {place.offset}: {error}; restore it from a copy, or run: armgate recover"
        raise DamagedError(place.file, f"{text} {place.file}") from error
