"""Writes one file of a recording."""

from typing import Protocol

from mcap.writer import CompressionType, Writer

from armgate.recording import codec, form

_NS = 1_000_000_000
_CHUNK = 1 << 20
"""Bytes of messages after which a chunk ends even if nobody asks for it."""


class Stream(Protocol):
    """Where the bytes go."""

    def write(self, data: bytes, /) -> int:
        """Takes all of the bytes, or raises OSError."""

    def tell(self) -> int:
        """How many bytes were written."""

    def flush(self) -> None:
        """Hands everything to the operating system."""


class Sink:
    """Writes items into one file.

    What was put is safe against the death of the process once ``flush`` has returned; it ends a chunk, and
    chunks compress the better the longer they are.

    Args:
        stream: Where the bytes go.
        header: What the recording is of.

    Raises:
        OSError: It cannot be written.
    """

    def __init__(self, stream: Stream, header: form.Header) -> None:
        self._stream = stream
        self._origin = header.origin_ns
        self._writer = Writer(stream, chunk_size=_CHUNK, compression=CompressionType.ZSTD)
        self._writer.start(profile=form.PROFILE, library=f"armgate {header.software.get('armgate', '')}")
        said = {"format": header.format, "start": header.start, "part": header.part, "hash": header.hash}
        self._writer.add_metadata(form.METADATA, {key: str(value) for key, value in said.items()})
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._waiting = self._count = 0
        # All at the beginning: who goes to a later chunk directly needs to have read only the first.
        for topic in form.topics(header):
            self._channel(topic)
        self._put(form.RUN, header.model_dump_json().encode(), 0.0)
        self.flush()

    @property
    def size(self) -> int:
        """Bytes written so far, without what waits."""
        return self._stream.tell()

    def put(self, item: codec.Item, time: float) -> None:
        """Adds an item of the daemon time ``time`` [s].

        Raises:
            OSError: It cannot be written.
        """
        self._put(*codec.encode(item), time)

    def flush(self) -> None:
        """Hands everything to the operating system.

        Raises:
            OSError: It cannot be written.
        """
        if self._waiting:
            self._writer.flush()
            self._waiting = 0

    def close(self) -> None:
        """Writes the index: then the file is whole. The stream stays open.

        Raises:
            OSError: It cannot be written.
        """
        self._writer.finish()
        self._stream.flush()

    def _put(self, topic: str, data: bytes, time: float) -> None:
        channel = self._channels.get(topic) or self._channel(topic)
        ns = self._origin + round(time * _NS)
        self._writer.add_message(channel, ns, data, ns, self._count)
        self._waiting += 1
        self._count = (self._count + 1) & 0xFFFFFFFF

    def _channel(self, topic: str) -> int:
        name, schema = form.schema_of(topic)
        if name not in self._schemas:
            self._schemas[name] = self._writer.register_schema(name, "jsonschema", schema)
        channel: int = self._writer.register_channel(topic, "json", self._schemas[name])
        self._channels[topic] = channel
        return channel
