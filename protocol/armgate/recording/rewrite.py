"""Writes a file anew that was never closed: its whole chunks, then the index that it lacks."""

import os
from pathlib import Path

from mcap.records import Channel, Message, Schema
from mcap.writer import CompressionType, Writer

from armgate.recording.form import METADATA, PROFILE, RUN, Header
from armgate.recording.scan import records, scan


def rewrite(file: Path, new: Path) -> tuple[int, int]:
    """Writes what is whole in ``file`` as the whole file ``new``.

    Topics, schemas, times, order and data of the messages stay as they are.

    Returns:
        How many messages there are, and how many bytes at the end were no whole record.

    Raises:
        RecordingError: It is no recording, or damaged.
        OSError: One of them cannot be read or written.
    """
    found = scan(file)
    count = 0
    with new.open("wb") as stream:
        writer = Writer(stream, chunk_size=1 << 30, compression=CompressionType.ZSTD)
        topics: dict[int, str] = {}
        writer.start(profile=PROFILE, library="armgate recover")
        for place in found.chunks:
            for record in records(place):
                if isinstance(record, Schema):
                    writer.register_schema(record.name, record.encoding, record.data)
                elif isinstance(record, Channel):
                    topics[record.id] = record.topic
                    writer.register_channel(record.topic, record.message_encoding, record.schema_id)
                elif isinstance(record, Message):
                    if topics[record.channel_id] == RUN:
                        _say_format(writer, Header.model_validate_json(record.data))
                    writer.add_message(
                        record.channel_id, record.log_time, record.data, record.publish_time, record.sequence
                    )
                    count += 1
            writer.flush()
        writer.finish()
        stream.flush()
        os.fsync(stream.fileno())
    return count, found.size - found.good


def _say_format(writer: Writer, header: Header) -> None:
    said = {"format": header.format, "start": header.start, "part": header.part, "hash": header.hash}
    writer.add_metadata(METADATA, {key: str(value) for key, value in said.items()})
