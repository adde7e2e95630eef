"""Bounded decoder of the records in one chunk: a small file must not exhaust the memory."""

import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from typing import Any

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Message, Schema

LARGEST = 1 << 28
"""Largest chunk in bytes of messages. A chunk ends after 1 MiB, but the first one also holds all meshes."""
_DENSEST, _SMALL = 256, 1 << 16
"""Largest compression ratio; chunks of fewer bytes than ``_SMALL`` may exceed it."""
_PREFIX = struct.Struct("<BQ")


class ChunkError(Exception):
    """Damaged chunk; the text states the fault."""


def read_chunk(content: bytes) -> Iterator[Any]:
    """Yield the schemas, channels and messages of a chunk.

    Args:
        content: Content of the chunk's record.

    Raises:
        ChunkError: The chunk is damaged, or larger than armgate ever writes.
    """
    try:
        data = _unpacked(Chunk.read(ReadDataStream(BytesIO(content))))
        for kind, part in _parts(data):
            record = _record(kind, part)
            if record is not None:
                yield record
    except (
        McapError, EOFError, ValueError, OverflowError, MemoryError, struct.error, RuntimeError,
        zstandard.ZstdError,
    ) as error:  # fmt: skip
        raise ChunkError(str(error) or type(error).__name__) from error


def _unpacked(chunk: Chunk) -> Any:
    size = chunk.uncompressed_size
    if size > LARGEST or size > max(_DENSEST * len(chunk.data), _SMALL):
        raise ChunkError(f"{size} bytes of messages in {len(chunk.data)}; armgate writes no such chunk")
    match chunk.compression:
        case "":
            data = chunk.data
        case "zstd":
            data = _zstd(chunk.data, size)
        case "lz4":
            data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, size + 1)
        case other:
            raise ChunkError(f"compression {other[:20]!r}; expected zstd")
    if len(data) != size:
        raise ChunkError(f"{len(data)} bytes of messages; expected {size}")
    if chunk.uncompressed_crc not in (0, zlib.crc32(data)):
        raise ChunkError("wrong checksum")
    return data


def _zstd(data: bytes, size: int) -> Any:
    """Decompress a frame; its own header must not request more memory than the chunk's."""
    declared = zstandard.get_frame_parameters(data).content_size
    if declared not in (size, zstandard.CONTENTSIZE_UNKNOWN):
        raise ChunkError(f"{declared} bytes of messages; expected {size}")
    return zstandard.ZstdDecompressor().decompress(data, max_output_size=max(size, 1))


def _parts(data: bytes) -> Iterator[tuple[int, bytes]]:
    at = 0
    while at < len(data):
        if at + _PREFIX.size > len(data):
            raise ChunkError("ends within a record")
        kind, length = _PREFIX.unpack_from(data, at)
        at += _PREFIX.size
        if length > len(data) - at:
            raise ChunkError("ends within a record")
        yield kind, data[at : at + length]
        at += length


def _record(kind: int, data: bytes) -> Any:
    stream = ReadDataStream(BytesIO(data))
    match kind:
        case Opcode.SCHEMA:
            return Schema.read(stream)
        case Opcode.CHANNEL:
            return Channel.read(stream)
        case Opcode.MESSAGE:
            return Message.read(stream, len(data))
        case _:
            return None  # a kind that a later format added: the set of kinds is open
