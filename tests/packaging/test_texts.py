"""Changelog, links and paths in the texts: the version is listed, links resolve, no path names a machine."""

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = (
    "protocol", "sim", "server", "client", "configs", "docs",
    "tests", "tools", "examples", "benchmarks", ".ci", ".github",
)  # fmt: skip
UNWRITTEN = {"__pycache__", "out"}
MARKDOWN = sorted([*ROOT.glob("*.md"), *(path for f in FOLDERS for path in (ROOT / f).rglob("*.md"))])

LINK = re.compile(r"!?\[[^\]]*\]\(\s*<?([^)\s>]+)>?[^)]*\)|<img[^>]*\ssrc=\"([^\"]+)\"")
FENCED = re.compile(r"^(```|~~~).*?^\1\s*$", re.MULTILINE | re.DOTALL)
HEADING = re.compile(r"^#{1,6}\s+(.+?)\s*#*$", re.MULTILINE)
MACHINE = re.compile(r"(?<![\w.~}$)/-])/(?:home|root|Users|work|workspace|builds|mnt|media|tmp)/\w")


def written_files() -> Iterator[Path]:
    yield from (path for path in ROOT.iterdir() if path.is_file() and path.name not in {".coverage", ".git"})
    for folder in FOLDERS:
        for path in (ROOT / folder).rglob("*"):
            if path.is_file() and not UNWRITTEN & set(path.parts):
                yield path


def prose(path: Path) -> str:
    """Return the text of a Markdown file without its code blocks, which may contain anything."""
    return FENCED.sub("", path.read_text(encoding="utf-8"))


def anchors(path: Path) -> set[str]:
    """Return the anchors of a Markdown file's headings, by the rule of the usual forges."""
    titles = (re.sub(r"[^\w\- ]", "", title.lower()) for title in HEADING.findall(prose(path)))
    return {title.replace(" ", "-") for title in titles}


def broken_links(path: Path) -> Iterator[str]:
    for groups in LINK.findall(prose(path)):
        link = groups[0] or groups[1]
        if re.match(r"[a-z]+:", link):
            continue
        name, _, anchor = link.partition("#")
        target = (path.parent / name).resolve() if name else path
        if not target.exists() or (anchor and anchor not in anchors(target)):
            yield link


def test_the_newest_entry_of_the_changelog_is_this_version() -> None:
    version = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    titles = re.findall(
        r"^## \[([^\]]+)\]", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE
    )
    assert titles, "CHANGELOG.md has no entry"
    assert titles[0] in {"Unreleased", version}, f"the newest entry shall be Unreleased or {version}"


@pytest.mark.parametrize("path", MARKDOWN, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_lead_to_files_and_anchors(path: Path) -> None:
    assert list(broken_links(path)) == []


def test_a_broken_link_is_found(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(
        "# One thing\n[a](#one-thing) [b](#two) ![c](no.svg) [d](https://example.org/x)\n", "utf-8"
    )
    assert list(broken_links(page)) == ["#two", "no.svg"]


def test_files_contain_no_path_of_a_machine() -> None:
    found = []
    for path in written_files():
        text = path.read_bytes().decode("utf-8", errors="ignore")
        found += [f"{path.relative_to(ROOT)}: {match[0]}…" for match in MACHINE.finditer(text)]
    assert found == [], "paths are relative to the repository, or arguments of a command"


def test_a_path_of_a_machine_is_found() -> None:
    assert MACHINE.search("see " + "/".join(["", "home", "me", "cell.yaml"]))
    assert not MACHINE.search("docs/home/me and https://example.org/home/me")
