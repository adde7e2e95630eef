"""Writes one file of a recording."""

import errno

from armgate.recording import codec, form
from armgate.recording.chain import ChainWriter, Seal, Signer, Stream
from armgate.recording.chunk import LARGEST

_NS = 1_000_000_000


class Sink:
    """Writes items into one file.

    What was put is safe against the death of the process once ``flush`` has returned; it ends a chunk, and
    chunks compress the better the longer they are.

    Args:
        stream: Where the bytes go.
        header: What the recording is of.
        signer: Signs the seal; None: no signature.

    Raises:
        OSError: It cannot be written.
    """

    def __init__(self, stream: Stream, header: form.Header, signer: Signer | None = None) -> None:
        self._stream = stream
        self._origin = header.origin_ns
        library = f"armgate {header.software.get('armgate', '')}"
        self._writer = ChainWriter(stream, library, signer=signer)
        self._writer.add_metadata(form.METADATA, form.metadata(header))
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._count = 0
        # All at the beginning: who goes to a later chunk directly needs to have read only the first.
        for topic in form.topics(header):
            self._channel(topic)
        self._writer.chain(self._channels[form.CHAIN])
        data = header.model_dump_json().encode()
        if len(data) > LARGEST // 2:
            raise OSError(
                errno.EFBIG, f"the cell's files are {len(data)} bytes, more than a recording can hold"
            )
        self._put(form.RUN, data, 0.0)
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
        self._writer.flush()

    def close(self, *, last: bool = True) -> Seal:
        """Write the seal and the index: then the file is whole. The stream stays open.

        Args:
            last: False if another part follows.

        Raises:
            OSError: It cannot be written.
        """
        return self._writer.finish(last=last)

    def _put(self, topic: str, data: bytes, time: float) -> None:
        channel = self._channels.get(topic) or self._channel(topic)
        ns = self._origin + round(time * _NS)
        self._writer.add(channel, ns, data, self._count)
        self._count = (self._count + 1) & 0xFFFFFFFF

    def _channel(self, topic: str) -> int:
        name, schema = form.schema_of(topic)
        if name not in self._schemas:
            self._schemas[name] = self._writer.register_schema(name, "jsonschema", schema)
        channel: int = self._writer.register_channel(topic, "json", self._schemas[name])
        self._channels[topic] = channel
        return channel
