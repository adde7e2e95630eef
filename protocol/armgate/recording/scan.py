"""Finds what is whole in one file, be it whole itself or not.

A record of MCAP says its kind and its length, so a file is read forward without its index: an index is only
written when a file is closed, and a killed daemon closes none.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from struct import Struct

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.records import Channel, Chunk, Header, McapRecord, Message, Metadata
from mcap.stream_reader import breakup_chunk

from armgate.recording import form
from armgate.recording.errors import DamagedError, ForeignError, NewerFormatError

_MAGIC = b"\x89MCAP0\r\n"
_PREFIX = Struct("<BQ")
_TIMES = Struct("<QQ")
_HEADER, _FOOTER, _CHUNK, _METADATA = 0x01, 0x02, 0x06, 0x0C
_LARGEST = 1 << 30


@dataclass(frozen=True, slots=True)
class Place:
    """Where a chunk stands: file, first byte of its content, length, and its messages' times [ns]."""

    file: Path
    offset: int
    length: int
    first_ns: int
    last_ns: int


@dataclass(frozen=True, slots=True)
class Scan:
    """What is whole in a file.

    Attributes:
        file: The file.
        chunks: Its whole chunks, in order.
        good: Bytes up to the end of the last whole record.
        size: All bytes.
        closed: Whether the file was closed: it ends as a whole file does.
    """

    file: Path
    chunks: tuple[Place, ...]
    good: int
    size: int
    closed: bool


def scan(file: Path) -> Scan:
    """Looks through a file, without reading the chunks' content.

    Raises:
        OSError: It cannot be read.
        ForeignError: It is no recording of armgate.
        NewerFormatError: It was written by a later armgate.
    """
    size = file.stat().st_size
    with file.open("rb") as stream:
        start = stream.read(len(_MAGIC))
        if not start or not _MAGIC.startswith(start[: len(_MAGIC)]):
            if size:
                raise ForeignError(file, "not MCAP; expected a recording of armgate")
            return Scan(file, (), 0, 0, closed=False)
        chunks: list[Place] = []
        good, closed = stream.tell(), False
        while (record := _prefix(stream.read(_PREFIX.size))) is not None:
            kind, length = record
            content = good + _PREFIX.size
            if length > _LARGEST or content + length > size:
                break
            if kind in (_HEADER, _METADATA):
                _check(file, kind, stream.read(length))
            elif kind == _CHUNK:
                first, last = _TIMES.unpack(stream.read(_TIMES.size))
                chunks.append(Place(file, content, length, first, last))
            elif kind == _FOOTER:
                stream.seek(content + length)
                closed = stream.read(len(_MAGIC)) == _MAGIC
            good = content + length
            stream.seek(good)
            if closed:
                good += len(_MAGIC)
                break
    return Scan(file, tuple(chunks), good, size, closed and good == size)


def _prefix(data: bytes) -> tuple[int, int] | None:
    if len(data) < _PREFIX.size:
        return None
    kind, length = _PREFIX.unpack(data)
    return kind, length


def _check(file: Path, kind: int, content: bytes) -> None:
    """Whether this is ours, and of a form that we know."""
    stream = ReadDataStream(BytesIO(content))
    try:
        if kind == _HEADER:
            profile = Header.read(stream).profile
            if profile != form.PROFILE:
                text = f"MCAP of the profile {profile!r}; expected a recording of armgate"
                raise ForeignError(file, text)
            return
        metadata = Metadata.read(stream)
        written = int(metadata.metadata.get("format", "0")) if metadata.name == form.METADATA else 0
    except (McapError, ValueError, UnicodeDecodeError, EOFError) as error:
        raise DamagedError(file, f"damaged at its beginning: {error}") from error
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

    def messages(self, place: Place) -> Iterator[Message_]:
        """Topic, log time [ns] and data of every message of a chunk.

        Raises:
            DamagedError: The chunk is not what was written.
        """
        for record in records(place):
            if isinstance(record, Channel):
                self._topics[record.id] = record.topic
            elif isinstance(record, Message):
                yield self._topics.get(record.channel_id, ""), record.log_time, record.data


def records(place: Place) -> list[McapRecord]:
    """All records of a chunk.

    Raises:
        DamagedError: The chunk is not what was written.
    """
    with place.file.open("rb") as stream:
        stream.seek(place.offset)
        content = stream.read(place.length)
    try:
        found: list[McapRecord] = breakup_chunk(Chunk.read(ReadDataStream(BytesIO(content))), True)
    except Exception as error:  # the library and what it decompresses with raise what they like
        text = f"damaged at byte {place.offset}: {error}; restore it from a copy"
        raise DamagedError(place.file, text) from error
    return found
