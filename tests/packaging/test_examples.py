"""The examples in the documents are valid: configurations load, programs are Python, named files exist."""

import ast
import re
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from armgate.cell.cell import build_cell
from armgate.cell.config import load_config

ROOT = Path(__file__).resolve().parents[2]
DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def blocks(path: Path, language: str) -> list[str]:
    fenced = re.compile(rf"^```{language}(?: [^\n]*)?\n(.*?)^```$", re.MULTILINE | re.DOTALL)
    return fenced.findall(path.read_text(encoding="utf-8"))


def python_blocks() -> Iterator[object]:
    for path in DOCUMENTS:
        for number, block in enumerate(blocks(path, "python")):
            yield pytest.param(block, id=f"{path.stem}-{number}")


def test_the_cell_of_the_configuration_page_can_be_built(tmp_path: Path) -> None:
    shutil.copytree(ROOT / "configs" / "robots", tmp_path / "robots")
    whole, *overlays = blocks(ROOT / "docs" / "configuration.md", "yaml")
    files = []
    for number, text in enumerate([whole, *overlays]):
        files.append(tmp_path / f"{number}.yaml")
        files[-1].write_text(text, encoding="utf-8")
    cell = build_cell(load_config(files[:1]))
    assert [robot.model.n for robot in cell.robots] == [6, 9]
    for overlay in files[1:]:
        load_config([files[0], overlay])


@pytest.mark.parametrize("block", [*python_blocks()])
def test_programs_in_the_documents_are_python(block: str) -> None:
    tree = ast.parse(block)
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "armgate":
            module = __import__(node.module, fromlist=[alias.name for alias in node.names])
            assert all(hasattr(module, alias.name) for alias in node.names)


def test_files_in_the_documents_commands_exist() -> None:
    for path in DOCUMENTS:
        named = set(re.findall(r"\b(configs/[\w/.-]+\.\w+)", path.read_text(encoding="utf-8")))
        assert [name for name in sorted(named) if not (ROOT / name).is_file()] == []
