"""Assets of a cell: large texts that clients read in pieces, by their hash."""

import hashlib
from collections.abc import Iterable
from typing import Any

import numpy as np

from armgate.cell.mesh.hull import hull_of
from armgate.cell.shapes import Convex
from armgate.protocol import ErrorCode, RemoteProtocolError
from armgate.protocol import messages as m


class Assets:
    """Assets of one cell.

    Attributes:
        by_hash: Their bytes, by SHA-256 in hexadecimal form.

    Args:
        texts: Their texts.
    """

    def __init__(self, texts: Iterable[str]) -> None:
        self.by_hash = {_sha256(text): text.encode() for text in texts}

    def chunk(self, hash_: str, offset: int, length: int, re: int | None = None) -> m.Chunk:
        """Return a piece of an asset, as the answer to request ``re``.

        Raises:
            RemoteProtocolError: ``unknown_asset``: no asset has this hash, or it ends before ``offset``.
        """
        data = self.by_hash.get(hash_)
        if data is None:
            raise _unknown(f"no asset {hash_}; the description names those that exist")
        if offset > len(data):
            raise _unknown(f"asset {hash_[:12]}… ends at byte {len(data)}; requested was byte {offset}")
        fields: dict[str, Any] = {} if re is None else {"re": re}
        piece = data[offset : offset + length]
        return m.Chunk(hash=hash_, offset=offset, total=len(data), data=piece, **fields)


def asset_reference(text: str, media: str) -> m.AssetRef:
    """Return hash, size and media type of an asset, as in a description."""
    return m.AssetRef(hash=_sha256(text), size=len(text.encode()), media=media)


def to_obj(shape: Convex) -> str:
    """Return a convex hull as Wavefront OBJ, with its triangles wound outward."""
    hull = hull_of(np.array(shape.vertices))
    middle = hull.vertices.mean(axis=0)
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in hull.vertices.tolist()]
    for face in hull.faces:
        a, b, c = hull.vertices[face] - middle
        i, j, k = (face if np.dot(np.cross(b - a, c - a), a) >= 0.0 else face[::-1]) + 1
        lines.append(f"f {i} {j} {k}")
    return "\n".join(lines) + "\n"


def _unknown(text: str) -> RemoteProtocolError:
    return RemoteProtocolError(ErrorCode.UNKNOWN_ASSET, text, about="asset")


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
