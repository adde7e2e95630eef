"""Hash chain of a recording: its chunks begin with SHA-256 digests that cover all bytes before them.

Let s₀, s₁, … be the bytes of a file, divided before each chunk that begins with a link. Link k + 1 holds
dₖ₊₁ = SHA-256(dₖ ‖ sₖ), with d₀ empty. The seal, written when the file is closed, holds the last digest. The
header of a later part contains the seal of the previous part, and a record just before the seal states
whether another part follows. Therefore no byte can be changed, removed or inserted, and no part removed,
without changing all later links and the seal. A signature of the seal identifies the writer.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from hashlib import sha256
from typing import Protocol

from mcap.writer import CompressionType, Writer

from armgate.recording.header import END, PROFILE, SEAL, end_record


class Stream(Protocol):
    """Destination of the bytes."""

    def write(self, data: bytes, /) -> int:
        """Write all bytes, or raise OSError."""

    def tell(self) -> int:
        """Return the number of bytes written."""

    def flush(self) -> None:
        """Pass all bytes to the operating system."""


class Signer(Protocol):
    """Private key that signs seals."""

    @property
    def public(self) -> bytes:
        """Public key, 32 bytes of Ed25519."""

    def sign(self, data: bytes, /) -> bytes:
        """Return the signature of ``data``."""


@dataclass(frozen=True, slots=True)
class Seal:
    """End of a file's chain.

    Attributes:
        digest: Last digest of the chain.
        public: Public key of the signature; empty without a signature.
        signature: Signature of ``digest``.
        by: Program that wrote the file.
    """

    digest: bytes
    public: bytes = b""
    signature: bytes = b""
    by: str = ""

    def metadata(self) -> dict[str, str]:
        """Return the seal as a metadata record."""
        return {
            "sha256": self.digest.hex(), "key": self.public.hex(), "signature": self.signature.hex(),
            "by": self.by,
        }  # fmt: skip

    @classmethod
    def read(cls, metadata: Mapping[str, str]) -> "Seal":
        """Return the seal in a metadata record.

        Raises:
            ValueError: The record is not a seal.
        """
        digest, public, signature = (
            bytes.fromhex(metadata.get(name, "")) for name in ("sha256", "key", "signature")
        )
        return cls(digest, public, signature, metadata.get("by", ""))


class _Hashed:
    """Stream that also hashes the bytes written to it."""

    def __init__(self, stream: Stream) -> None:
        self._stream = stream
        self._digest = sha256()
        self.tell, self.flush = stream.tell, stream.flush

    def write(self, data: bytes) -> int:
        self._digest.update(data)
        return self._stream.write(data)

    def link(self) -> bytes:
        """Return the digest of the last link and of all bytes since then; begin the next link."""
        found = self._digest.digest()
        self._digest = sha256(found)
        return found


_CHUNK = 1 << 20
"""Bytes of messages after which a chunk ends without a flush."""


class ChainWriter:
    """Writer of an MCAP file with linked chunks.

    Args:
        stream: Destination of the bytes.
        library: Name and version of the writing program.
        signer: Key that signs the seal; None: no signature.
        chunk: Bytes of messages after which a chunk ends.

    Raises:
        OSError: The file cannot be written.
    """

    def __init__(
        self, stream: Stream, library: str, *, signer: Signer | None = None, chunk: int = _CHUNK
    ) -> None:
        self._hashed = _Hashed(stream)
        self._signer, self._library = signer, library
        self._writer = Writer(self._hashed, chunk_size=chunk, compression=CompressionType.ZSTD)
        self._writer.start(profile=PROFILE, library=library)
        self.register_schema: Callable[[str, str, bytes], int] = self._writer.register_schema
        self.register_channel: Callable[[str, str, int], int] = self._writer.register_channel
        self.add_metadata: Callable[[str, dict[str, str]], None] = self._writer.add_metadata
        self._channel: int | None = None
        self._due, self._waiting = False, True

    def chain(self, channel: int) -> None:
        """Write links on this channel, beginning with the next chunk."""
        self._channel = channel

    def add(self, channel: int, ns: int, data: bytes, sequence: int) -> None:
        """Add a message.

        Raises:
            OSError: The file cannot be written.
        """
        if self._due and self._channel is not None:
            link = json.dumps({"sha256": self._hashed.link().hex()}).encode()
            self._writer.add_message(self._channel, ns, link, ns, sequence)
            self._due = False
        self._writer.add_message(channel, ns, data, ns, sequence)
        self._waiting = True

    def flush(self) -> None:
        """End the chunk and pass all bytes to the operating system.

        Raises:
            OSError: The file cannot be written.
        """
        if self._waiting:
            self._writer.flush()
            self._due, self._waiting = True, False

    def finish(self, *, last: bool | None = None) -> Seal:
        """Seal the chain and write the index, which completes the file.

        Args:
            last: True if this part ends the recording, False if another part follows; None: not known.

        Raises:
            OSError: The file cannot be written.
        """
        self.flush()
        if last is not None:
            self._writer.add_metadata(END, end_record(last))
        digest, signer = self._hashed.link(), self._signer
        public, signature = (b"", b"") if signer is None else (signer.public, signer.sign(digest))
        seal = Seal(digest, public, signature, self._library)
        self._writer.add_metadata(SEAL, seal.metadata())
        self._writer.finish()
        self._hashed.flush()
        return seal
