"""A wheel contains all four portions with their data files, the licence and the commands, nothing else."""

import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("protocol", "sim", "server", "client")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> zipfile.ZipFile:
    out = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(out)]
    done = subprocess.run(build, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    (path,) = out.glob("*.whl")
    return zipfile.ZipFile(path)


def files_below(folder: Path) -> set[str]:
    files = (path for path in folder.rglob("*") if path.is_file() and "__pycache__" not in path.parts)
    return {path.relative_to(folder).as_posix() for path in files}


def source_files(folder: str) -> set[str]:
    return {f"armgate/{name}" for name in files_below(ROOT / folder / "armgate")}


def config_files() -> set[str]:
    return {f"armgate/apps/configs/{name}" for name in files_below(ROOT / "configs")}


@pytest.mark.parametrize("folder", FOLDERS)
def test_every_file_of_a_portion_is_in_the_wheel(wheel: zipfile.ZipFile, folder: str) -> None:
    files = source_files(folder)
    assert any(name.endswith(".py") for name in files)
    assert files - set(wheel.namelist()) == set()


def test_the_configurations_are_in_the_wheel(wheel: zipfile.ZipFile) -> None:
    assert "armgate/apps/configs/demo.yaml" in config_files()
    assert config_files() - set(wheel.namelist()) == set()


def test_the_wheel_contains_nothing_else(wheel: zipfile.ZipFile) -> None:
    ours = config_files().union(*map(source_files, FOLDERS))
    others = {name for name in wheel.namelist() if ".dist-info/" not in name} - ours
    assert others == set()


def test_the_wheel_contains_licence_and_commands(wheel: zipfile.ZipFile) -> None:
    info = f"armgate-{PROJECT['version']}.dist-info"
    assert "Apache License" in wheel.read(f"{info}/licenses/LICENSE").decode()
    points = wheel.read(f"{info}/entry_points.txt").decode()
    for name, target in PROJECT["entry-points"]["armgate.commands"].items():
        assert f"{name} = {target}" in points


def test_the_wheel_imports_without_the_sources(wheel: zipfile.ZipFile, tmp_path: Path) -> None:
    wheel.extractall(tmp_path)
    # An editable install keeps the sources on the path; they would hide files that the wheel lacks.
    sources = [str(ROOT / folder) for folder in FOLDERS]
    path = f"sys.path = [{str(tmp_path)!r}, *(p for p in sys.path if p not in {sources!r})]"
    modules = "armgate.protocol, armgate.client, armgate.cell.config, armgate.daemon, armgate.apps.cli"
    script = f"import sys; {path}; import {modules}; print(armgate.protocol.__file__)"
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False, cwd=tmp_path
    )
    assert done.returncode == 0, done.stderr
    assert Path(done.stdout.strip()).is_relative_to(tmp_path)
