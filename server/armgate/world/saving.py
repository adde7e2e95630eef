"""Saved worlds: pickled state, without the cell, which all copies share.

The cell is immutable and large. Its parts are therefore not pickled but named, and a restored world refers to
the parts of the cell that the caller provides. A header comes first, one line of JSON with the version of
armgate and the hashes of cell and state: a state is only restored undamaged, for the same cell and version.

Unpickling runs code from its input. Restore only what a program that you trust has saved.
"""

import hashlib
import io
import json
import pickle
from collections.abc import Iterator
from importlib.metadata import version
from typing import Any

from armgate.cell.cell import Cell
from armgate.world.description import CellDescription

_FORMAT = "armgate world 1"


class SavedWorldError(Exception):
    """Bytes that cannot be restored as a world of this cell."""


def save(root: object, cell: Cell, description: CellDescription) -> bytes:
    """Return the state of an object and of everything that it refers to, except parts of the cell."""
    file = io.BytesIO()
    _Pickler(file, _parts(cell, description)).dump(root)
    state = file.getvalue()
    return json.dumps(_header(cell, state)).encode() + b"\n" + state


def restore(data: bytes, cell: Cell, description: CellDescription) -> Any:
    """Return a new object with a saved state.

    Raises:
        SavedWorldError: The state is of another cell or version, or it is damaged.
    """
    header, _, state = data.partition(b"\n")
    try:
        given = json.loads(header)
    except ValueError as error:
        raise SavedWorldError(f"not a saved world: its header is not JSON: {error}") from error
    for key, own in _header(cell, state).items():
        found = given.get(key) if isinstance(given, dict) else None
        if found != own:
            raise SavedWorldError(f"cannot restore the world: its {key} is {found!r}; expected {own!r}")
    return _Unpickler(io.BytesIO(state), _parts(cell, description)).load()


def _header(cell: Cell, state: bytes) -> dict[str, str]:
    return {
        "format": _FORMAT,
        "armgate": version("armgate"),
        "cell": cell.hash,
        "sha256": hashlib.sha256(state).hexdigest(),
    }


def _parts(cell: Cell, description: CellDescription) -> dict[str, object]:
    return dict(_named_parts(cell, description))


def _named_parts(cell: Cell, description: CellDescription) -> Iterator[tuple[str, object]]:
    """Yield the parts of a cell by name; the names do not depend on the process."""
    yield from {"cell": cell, "config": cell.config, "bodies": cell.bodies, "pairs": cell.pairs}.items()
    yield "description", description
    for i, robot in enumerate(cell.robots):
        yield f"robot {i}", robot
        yield f"model {i}", robot.model
        yield f"config {i}", robot.config
    for i, body in enumerate(cell.bodies):
        yield f"body {i}", body
        yield f"shape {i}", body.shape
    for i, pair in enumerate(cell.pairs):
        yield f"pair {i}", pair


class _Pickler(pickle.Pickler):
    """Pickler that writes the names of parts instead of the parts."""

    def __init__(self, file: io.BytesIO, parts: dict[str, object]) -> None:
        super().__init__(file, protocol=pickle.HIGHEST_PROTOCOL)
        self._names = {id(part): name for name, part in parts.items()}

    def persistent_id(self, obj: object) -> str | None:
        """Return the name of a part, None for any other object."""
        return self._names.get(id(obj))


class _Unpickler(pickle.Unpickler):
    """Unpickler that returns parts by their names."""

    def __init__(self, file: io.BytesIO, parts: dict[str, object]) -> None:
        super().__init__(file)
        self._parts = parts

    def persistent_load(self, pid: str) -> object:
        """Return the part of this name."""
        return self._parts[pid]
