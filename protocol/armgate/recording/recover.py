"""Recovery of a file that was never closed, or is damaged: its readable part becomes a complete file.

After a damaged record, the next chunk is found by the byte pattern of its header. Lost records leave a
``Gap`` in the new file, so that a replay stops there instead of continuing without them.
"""

import mmap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import assert_never

from mcap.records import Channel, Message, Schema

from armgate.recording import codec
from armgate.recording.chain import ChainWriter, Stream
from armgate.recording.errors import DamagedError
from armgate.recording.files import open_file
from armgate.recording.header import METADATA, Header, header_record
from armgate.recording.scan import PREFIX, ChunkPosition, records, scan, scan_from
from armgate.recording.topics import CHAIN, GAP, RUN

_SIGN = b"\x04\x00\x00\x00zstd"
"""Compression name in the header of every chunk that armgate writes, with its length."""
_BEFORE = PREFIX.size + 28
"""Bytes of the chunk's record before ``_SIGN``: kind, length, two times, size and checksum."""
_MOST_LOST = 1 << 24
"""Largest plausible number of lost messages; beyond it, the sequence numbers themselves are damaged."""


@dataclass(frozen=True, slots=True)
class Recovery:
    """Result of a recovery.

    Attributes:
        messages: Number of messages in the new file, without gaps and links.
        dropped: Number of unreadable bytes at the end.
        lost: Number of unreadable messages before the end.
    """

    messages: int
    dropped: int
    lost: int


def recover_file(file: Path, stream: Stream) -> Recovery:
    """Write the readable part of a file to ``stream`` as a complete file.

    Topics, schemas, times, order and data of the messages stay unchanged.

    Raises:
        RecordingError: The file is not a recording, or its beginning is damaged.
        OSError: The file cannot be read, or the stream cannot be written.
    """
    found = scan(file)
    places = list(found.chunks)
    if not found.closed:
        places += _behind_damage(file, found.good, found.size)
    good = [place for place in places if _readable(place)]
    if not good or good[0] != places[0]:
        raise DamagedError(file, "the header of the recording is damaged; restore it from a copy")
    copy = _Copy(file, stream)
    for place in good:
        copy.add(place)
    copy.writer.finish()
    return Recovery(copy.messages, _dropped(places, good, found.good, found.size), copy.lost)


def is_readable(places: Sequence[ChunkPosition]) -> bool:
    """Return True if every chunk can be read."""
    return all(map(_readable, places))


def _dropped(places: Sequence[ChunkPosition], good: Sequence[ChunkPosition], end: int, size: int) -> int:
    """Return the number of bytes after the last readable chunk that could not be read."""
    tail = places[places.index(good[-1]) + 1 :]
    return size - (tail[0].begin if tail else max(end, good[-1].end))


def _readable(place: ChunkPosition) -> bool:
    try:
        for _ in records(place):
            pass
    except DamagedError:
        return False
    return True


def _behind_damage(file: Path, offset: int, size: int) -> Iterator[ChunkPosition]:
    """Yield the chunks after each damaged place."""
    while (begin := _next_chunk(file, offset, size)) is not None:
        found = scan_from(file, begin)
        yield from found
        offset = found[-1].end if found else begin + 1


def _next_chunk(file: Path, offset: int, size: int) -> int | None:
    """Return the first byte at or after ``offset`` at which a record with the form of a chunk begins."""
    if offset >= size:
        return None
    with open_file(file) as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
        at = data.find(_SIGN, offset + _BEFORE)
        while at >= 0:
            begin = at - _BEFORE
            kind, length = PREFIX.unpack_from(data, begin)
            inside = int.from_bytes(data[at + len(_SIGN) : at + len(_SIGN) + 8], "little")
            rest = at + len(_SIGN) + 8 - begin - PREFIX.size
            if kind == 0x06 and length == rest + inside and begin + PREFIX.size + length <= size:
                return begin
            at = data.find(_SIGN, at + 1)
    return None


class _Copy:
    """New file, written from the chunks of a damaged file."""

    def __init__(self, file: Path, stream: Stream) -> None:
        self.writer = ChainWriter(stream, "armgate recover", chunk=1 << 30)
        self.messages = self.lost = 0
        self._file = file
        self._schemas: dict[int, int] = {0: 0}
        self._channels: dict[int, int] = {}
        self._topics: dict[str, int] = {}
        self._sequence: int | None = None
        self._last_ns = 0

    def add(self, place: ChunkPosition) -> None:
        """Copy a chunk.

        Raises:
            DamagedError: The chunk was not written by armgate.
        """
        for record in records(place):
            match record:
                case Schema():
                    self._schemas[record.id] = self.writer.register_schema(
                        record.name, record.encoding, record.data
                    )
                case Channel():
                    self._add_channel(record)
                case Message():
                    self._add_message(record)
                case _:
                    assert_never(record)
        self.writer.flush()

    def _add_channel(self, record: Channel) -> None:
        if record.schema_id not in self._schemas:
            raise DamagedError(self._file, f"a topic without a schema: {record.topic[:60]!r}")
        schema = self._schemas[record.schema_id]
        channel = self.writer.register_channel(record.topic, record.message_encoding, schema)
        self._channels[record.id] = self._topics[record.topic] = channel
        if record.topic == CHAIN:
            self.writer.chain(channel)

    def _add_message(self, record: Message) -> None:
        channel = self._channels.get(record.channel_id)
        if channel is None:
            raise DamagedError(self._file, "a message without a topic")
        if channel == self._topics.get(CHAIN):
            return  # the new file gets its own links
        if channel == self._topics.get(RUN):
            self._write_format(record.data)
        self._mark_gap(record.sequence)
        self.writer.add(channel, record.log_time, record.data, record.sequence)
        self._last_ns = record.log_time
        self.messages += 1

    def _mark_gap(self, sequence: int) -> None:
        """Write a gap if messages are missing: the recorder numbers them consecutively."""
        expected, self._sequence = self._sequence, (sequence + 1) & 0xFFFFFFFF
        if expected is None or expected == sequence:
            return
        missing = (sequence - expected) & 0xFFFFFFFF
        missing = missing if missing <= _MOST_LOST else 1
        if GAP not in self._topics:
            raise DamagedError(self._file, "records are missing, and the file has no topic for gaps")
        _, data = codec.encode(codec.Gap(missing, missing))
        self.writer.add(self._topics[GAP], self._last_ns, data, sequence)
        self.lost += missing

    def _write_format(self, data: bytes) -> None:
        try:
            header = Header.model_validate_json(data)
        except ValueError as error:
            raise DamagedError(self._file, "the header of the recording is damaged") from error
        self.writer.add_metadata(METADATA, header_record(header))
