"""Download of an asset in pieces."""

import hashlib

from armgate.client.errors import ConnectionLost
from armgate.protocol.messages import MAX_CHUNK, Chunk

MAX_ASSET = 256 * 1024 * 1024
"""Largest accepted asset, bytes."""


class Download:
    """Download of one asset, verified by its SHA-256.

    Args:
        name: Hash of the asset from the description.
    """

    def __init__(self, name: str) -> None:
        self._hash = name
        self._data = bytearray()

    def request(self) -> dict[str, str | int]:
        """Return the fields of the next request."""
        return {"hash": self._hash, "offset": len(self._data), "length": MAX_CHUNK}

    def take(self, chunk: Chunk) -> bytes | None:
        """Add a piece; return the asset if it is complete, else None.

        Raises:
            ConnectionLost: The piece or the complete asset does not match the request.
        """
        fits = (chunk.hash, chunk.offset) == (self._hash, len(self._data))
        if not fits or chunk.total > MAX_ASSET or not (chunk.data or chunk.total == 0):
            raise ConnectionLost(f"asset {self._hash[:12]}…: the server sent a piece that was not requested")
        self._data += chunk.data
        if len(self._data) < chunk.total:
            return None
        if hashlib.sha256(self._data).hexdigest() != self._hash:
            raise ConnectionLost(f"asset {self._hash[:12]}…: the server sent data with another hash")
        return bytes(self._data)
