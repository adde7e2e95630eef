"""Fetching an asset piece by piece."""

import hashlib

from armgate.client.errors import ConnectionLost
from armgate.protocol.messages import MAX_CHUNK, Chunk

MAX_ASSET = 256 * 1024 * 1024
"""The largest asset that is fetched, bytes."""


class Download:
    """One asset: asks for what is missing until its SHA-256 fits.

    Args:
        name: The asset's hash, as the description names it.
    """

    def __init__(self, name: str) -> None:
        self._hash = name
        self._data = bytearray()

    def request(self) -> dict[str, str | int]:
        """The fields of the next request."""
        return {"hash": self._hash, "offset": len(self._data), "length": MAX_CHUNK}

    def take(self, chunk: Chunk) -> bytes | None:
        """Takes a piece; the whole once it is complete, None before.

        Raises:
            ConnectionLost: The pieces do not make the asset that was asked for.
        """
        fits = (chunk.hash, chunk.offset) == (self._hash, len(self._data))
        if not fits or chunk.total > MAX_ASSET or not (chunk.data or chunk.total == 0):
            raise ConnectionLost(f"asset {self._hash[:12]}…: the server sent a piece that was not asked for")
        self._data += chunk.data
        if len(self._data) < chunk.total:
            return None
        if hashlib.sha256(self._data).hexdigest() != self._hash:
            raise ConnectionLost(f"asset {self._hash[:12]}…: what the server sent has another hash")
        return bytes(self._data)
