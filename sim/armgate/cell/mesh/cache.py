"""Keeps what was cut: files in the user's cache folder, safe to delete, never trusted.

A damaged or foreign file cannot make a body smaller: whoever loads parts proves anew that they contain
the mesh.
"""

import contextlib
import hashlib
import json
import os
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from armgate.cell.mesh.hull import Array

_FORM = 1
"""Of the files and of the way of cutting; raised whenever either changes."""


def folder() -> Path:
    """``$XDG_CACHE_HOME/armgate/parts``, by default below ``~/.cache``."""
    base = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(base) if base.startswith("/") else Path.home() / ".cache") / "armgate" / "parts"


def key(data: bytes, *parameters: object) -> str:
    """Name of what is cut from these bytes with these parameters."""
    text = json.dumps([_FORM, *parameters], default=str)
    return hashlib.sha256(text.encode() + b"\n" + data).hexdigest()


def read(name: str) -> list[Array] | None:
    """The corners of the parts kept under a name, None if there are none or they cannot be read."""
    try:
        parts = json.loads((folder() / f"{name}.json").read_text(encoding="utf-8"))
        corners = [np.array(part, dtype=np.float64) for part in parts]
    except (OSError, ValueError, TypeError):
        return None
    good = all(part.ndim == 2 and part.shape[1] == 3 and np.all(np.isfinite(part)) for part in corners)
    return corners if corners and good else None


def write(name: str, parts: Sequence[Array]) -> None:
    """Keeps the corners of parts; a cache that cannot be written to is no error."""
    with contextlib.suppress(OSError):
        folder().mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile("w", dir=folder(), suffix=".part", delete=False) as file:
            json.dump([part.tolist() for part in parts], file)
        Path(file.name).replace(folder() / f"{name}.json")
