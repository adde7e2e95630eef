"""The four folders are portions of one namespace; every package in them is typed and under an import rule."""

import configparser
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PORTIONS = [ROOT / folder / "armgate" for folder in ("protocol", "sim", "server", "client")]
PACKAGES = sorted(
    path for portion in PORTIONS for path in portion.iterdir() if path.is_dir() and path.name != "__pycache__"
)


@pytest.mark.parametrize("portion", PORTIONS, ids=lambda path: path.parent.name)
def test_a_portion_of_the_namespace_holds_packages_only(portion: Path) -> None:
    assert portion.is_dir()
    stray = sorted(path.name for path in portion.iterdir() if path.is_file())
    assert stray == [], (
        f"{portion} holds packages only; a file there, in particular an __init__.py, hides the other portions"
    )


def test_package_names_are_unique() -> None:
    names = [package.name for package in PACKAGES]
    assert len(names) == len(set(names)), "two portions hold the same package: one of them is never imported"


@pytest.mark.parametrize("package", PACKAGES, ids=lambda path: path.name)
def test_each_package_is_typed(package: Path) -> None:
    assert (package / "__init__.py").is_file(), f"{package.name} needs an __init__.py"
    assert (package / "py.typed").is_file(), (
        f"{package.name} needs a py.typed, or its types are lost to users"
    )


@pytest.mark.parametrize("package", PACKAGES, ids=lambda path: path.name)
def test_each_package_is_under_an_import_rule(package: Path) -> None:
    config = configparser.ConfigParser()
    config.read(ROOT / ".importlinter", encoding="utf-8")
    sources = " ".join(config[section].get("source_modules", "") for section in config.sections())
    assert f"armgate.{package.name}" in sources.split(), f"name armgate.{package.name} in .importlinter"


def test_test_folders_are_not_packages() -> None:
    strays = sorted(str(path.relative_to(ROOT)) for path in (ROOT / "tests").rglob("__init__.py"))
    assert strays == [], "tests are imported by path (importmode importlib), so they need no __init__.py"
