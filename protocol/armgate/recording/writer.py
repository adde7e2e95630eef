"""Writer of one file of a recording."""

import errno

from armgate.recording import codec
from armgate.recording.chain import ChainWriter, Seal, Signer, Stream
from armgate.recording.chunk import LARGEST
from armgate.recording.header import METADATA, Header, header_record
from armgate.recording.topics import CHAIN, RUN, all_topics, schema_of

_NS = 1_000_000_000


class RecordingWriter:
    """Writer of items into one file.

    Items survive a crash of the process once ``flush`` has returned. ``flush`` ends a chunk; longer chunks
    compress better.

    Args:
        stream: Destination of the bytes.
        header: Header of the recording.
        signer: Key that signs the seal; None: no signature.

    Raises:
        OSError: The file cannot be written.
    """

    def __init__(self, stream: Stream, header: Header, signer: Signer | None = None) -> None:
        self._stream = stream
        self._origin = header.origin_ns
        library = f"armgate {header.software.get('armgate', '')}"
        self._writer = ChainWriter(stream, library, signer=signer)
        self._writer.add_metadata(METADATA, header_record(header))
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._count = 0
        # Register all topics in the first chunk: a reader that jumps to a later chunk needs only the first.
        for topic in all_topics(header):
            self._channel(topic)
        self._writer.chain(self._channels[CHAIN])
        data = header.model_dump_json().encode()
        if len(data) > LARGEST // 2:
            raise OSError(
                errno.EFBIG, f"the cell's files are {len(data)} bytes, more than a recording can hold"
            )
        self._put(RUN, data, 0.0)
        self.flush()

    @property
    def size(self) -> int:
        """Number of bytes written so far, without those still buffered."""
        return self._stream.tell()

    def put(self, item: codec.Item, time: float) -> None:
        """Add an item of the daemon time ``time`` [s].

        Raises:
            OSError: The file cannot be written.
        """
        self._put(*codec.encode(item), time)

    def flush(self) -> None:
        """End the chunk and pass all bytes to the operating system.

        Raises:
            OSError: The file cannot be written.
        """
        self._writer.flush()

    def close(self, *, last: bool = True) -> Seal:
        """Write the seal and the index, which completes the file. The stream stays open.

        Args:
            last: False if another part follows.

        Raises:
            OSError: The file cannot be written.
        """
        return self._writer.finish(last=last)

    def _put(self, topic: str, data: bytes, time: float) -> None:
        channel = self._channels.get(topic) or self._channel(topic)
        ns = self._origin + round(time * _NS)
        self._writer.add(channel, ns, data, self._count)
        self._count = (self._count + 1) & 0xFFFFFFFF

    def _channel(self, topic: str) -> int:
        name, schema = schema_of(topic)
        if name not in self._schemas:
            self._schemas[name] = self._writer.register_schema(name, "jsonschema", schema)
        channel: int = self._writer.register_channel(topic, "json", self._schemas[name])
        self._channels[topic] = channel
        return channel
