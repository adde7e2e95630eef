from pathlib import Path

import pytest

from armgate.cell.cell import Cell, build_cell
from armgate.cell.config import load_config

ROOT = Path(__file__).parents[2]
CONFIGS = ROOT / "configs"


@pytest.fixture(scope="session")
def configs() -> Path:
    return CONFIGS


@pytest.fixture(scope="session")
def demo() -> Cell:
    return build_cell(load_config([CONFIGS / "demo.yaml"]))


@pytest.fixture(scope="session")
def planar() -> Cell:
    return build_cell(load_config([CONFIGS / "planar.yaml"]))
