"""Generated pages and pictures are up to date with the code, and complete."""

import re
from pathlib import Path

import pytest

from armgate.apps.cli import GROUP, commands
from armgate.cell.config.link_kinds import _registered, installed_kinds
from tools import packages
from tools.reference.__main__ import pages
from tools.reference.own import own_entry_points

ROOT = Path(__file__).resolve().parents[2]
PAGES = pages()


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_a_reference_page_is_up_to_date(path: Path) -> None:
    assert path.read_text(encoding="utf-8") == PAGES[path], "run: make reference"


def test_the_pages_leave_out_installed_plugins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    info = tmp_path / "plugin-1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: plugin\nVersion: 1\n")
    (info / "entry_points.txt").write_text(
        "[armgate.links]\nplug = plug:KIND\n[armgate.commands]\nplug = plug:main\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    _registered.cache_clear()
    assert {"plug"} <= set(commands()) & set(installed_kinds())
    assert pages() == PAGES
    _registered.cache_clear()


def test_the_map_of_packages_is_up_to_date() -> None:
    assert packages.main(["--check"]) == 0, "run: make reference"


def test_every_command_has_a_section() -> None:
    text = PAGES[ROOT / "docs" / "cli.md"]
    sections = set(re.findall(r"^## armgate ([\w-]+)", text, re.MULTILINE))
    assert sections == {entry.name for entry in own_entry_points(GROUP)}


def test_every_option_has_a_meaning() -> None:
    rows = re.findall(r"^\| (`[^|]*`) \|.*\| ([^|]*) \|$", PAGES[ROOT / "docs" / "cli.md"], re.MULTILINE)
    assert len(rows) > 100
    assert [name for name, meaning in rows if not meaning.strip()] == []


def test_an_option_with_three_values_is_not_called_repeatable() -> None:
    (row,) = re.findall(r"^\| `--focus` .*$", PAGES[ROOT / "docs" / "cli.md"], re.MULTILINE)
    assert "`X Y Z`" in row
    assert "repeatable" not in row


def test_a_default_in_words_is_shown() -> None:
    (row,) = re.findall(r"^\| `--days` .*$", PAGES[ROOT / "docs" / "cli.md"], re.MULTILINE)
    assert row.split("|")[3].strip() == "never"


def test_the_usage_shows_which_arguments_are_optional_or_repeatable() -> None:
    text = PAGES[ROOT / "docs" / "cli.md"]
    assert "\narmgate check [OPTIONS] CONFIG...\n" in text
    assert "\narmgate demo [OPTIONS] [CONFIG]\n" in text
    assert "\narmgate status [OPTIONS] [HOST:PORT]\n" in text


def test_every_key_of_the_configuration_has_a_meaning() -> None:
    text = PAGES[ROOT / "docs" / "configuration-reference.md"]
    rows = re.findall(r"^\| (`\w+`) \|.*\| ([^|]*) \|$", text, re.MULTILINE)
    assert len(rows) > 100
    assert [name for name, meaning in rows if not meaning.strip()] == []


def test_links_of_the_configuration_lead_to_its_sections() -> None:
    text = PAGES[ROOT / "docs" / "configuration-reference.md"]
    anchors = {
        re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-")
        for title in re.findall(r"^## (.+)$", text, re.MULTILINE)
    }
    assert set(re.findall(r"\(#([^)]+)\)", text)) <= anchors


def test_packages_stand_above_what_they_import() -> None:
    graph = packages.reduced({"a": {"b", "c"}, "b": {"c"}, "c": set()})
    assert graph == {"a": {"b"}, "b": {"c"}, "c": set()}
    assert packages.floors(graph) == [["c"], ["b"], ["a"]]


def test_packages_that_import_each_other_are_an_error() -> None:
    with pytest.raises(ValueError, match="a -> b -> a"):
        packages.reduced({"a": {"b"}, "b": {"a"}})


def test_the_parts_of_the_daemon_in_the_architecture_exist() -> None:
    daemon = ROOT / "server" / "armgate" / "daemon"
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    section = text.partition("## Inside the daemon")[2].partition("\n## ")[0]
    listed = re.findall(r"^\| `(\w+)` \|", section, re.MULTILINE)
    assert sorted(listed) == sorted(path.parent.name for path in daemon.glob("*/__init__.py"))


def test_the_files_on_the_path_of_an_increment_exist() -> None:
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    section = text.partition("## An increment in files")[2].partition("\n## ")[0]
    files = re.findall(r"`([\w/]+\.py)`", section)
    assert len(files) > 20
    assert [name for name in files if not list(ROOT.glob(f"*/armgate/{name}"))] == []


def test_the_modules_in_the_page_about_the_gate_exist() -> None:
    text = (ROOT / "docs" / "gate.md").read_text(encoding="utf-8")
    table = text.split("| question | module of `armgate.gate` |\n")[1].split("\n\n")[0]
    named = set(re.findall(r"`(\w+)`", table))
    assert len(named) > 10
    gate = ROOT / "server" / "armgate" / "gate"
    assert named <= {path.stem for path in gate.iterdir()}


def test_every_package_is_in_the_architecture() -> None:
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    assert set(re.findall(r"\| `armgate\.(\w+)` \|", text)) == set(packages.owners())
