"""The demo cell as a scene, from its daemon's description."""

from pathlib import Path

import pytest

from armgate.apps.view.scene import Scene
from armgate.cell.cell import build_cell
from armgate.cell.config import load_config
from armgate.protocol import messages as m
from armgate.world.description import CellDescription

DEMO = Path(__file__).parents[3] / "configs" / "demo.yaml"


def whole(library: CellDescription, name: str) -> bytes:
    data = b""
    while True:
        chunk = library.assets.chunk(name, len(data), m.MAX_CHUNK)
        data += chunk.data
        if len(data) >= chunk.total:
            return data


@pytest.fixture(scope="session")
def cell():
    return build_cell(load_config([DEMO]))


def described(cell):
    """Return the description of a cell and its assets, as sent to clients."""
    library = CellDescription(cell, False)
    return library.description, lambda name: whole(library, name)


@pytest.fixture(scope="session")
def scene(cell):
    return Scene.build(*described(cell), meshes=False)
