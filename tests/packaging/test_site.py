"""The site of the documentation: links, diagrams, navigation, and the check of the built pages."""

import re
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
import yaml

from tools.site import check, diagrams, links

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted((ROOT / "docs").glob("*.md"))
WITH_DIAGRAMS = [
    path
    for path in [*PAGES, ROOT / links.SPEC / "SPEC.md"]
    if "```mermaid" in path.read_text(encoding="utf-8")
]


class Loader(yaml.SafeLoader):
    """Reader of mkdocs.yml, which names Python objects."""


Loader.add_multi_constructor("tag:yaml.org,2002:python/", lambda *_: None)


def navigation(entries: list[object]) -> list[str]:
    found: list[str] = []
    for entry in entries:
        for value in entry.values():  # type: ignore[attr-defined]
            found += navigation(value) if isinstance(value, list) else [value]
    return found


def test_the_navigation_holds_every_page_once() -> None:
    config = yaml.load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"), Loader)
    named = navigation(config["nav"])
    documents = set(links.DOCUMENTS.values()) - {"vectors.md"}
    assert sorted(named) == sorted({path.name for path in PAGES} | documents)


@pytest.mark.parametrize(
    ("source", "link", "page"),
    [
        ("docs/gate.md", "mutants.md#what", "mutants.md#what"),
        ("docs/gate.md", "../protocol/armgate/protocol/SPEC.md#leases", "spec.md#leases"),
        ("docs/gate.md", "../configs/demo.yaml", "files/configs/demo.yaml.md"),
        ("docs/gate.md", "../README.md", "index.md"),
        ("docs/gate.md", "https://example.org/x.md", "https://example.org/x.md"),
        ("docs/gate.md", "#words", "#words"),
        ("CONTRIBUTING.md", "docs/gate.md#the-proof", "gate.md#the-proof"),
        (
            "protocol/armgate/protocol/SPEC.md",
            "schema.json",
            "files/protocol/armgate/protocol/schema.json.md",
        ),
        ("protocol/armgate/protocol/SPEC.md", "vectors/README.md", "vectors.md"),
        ("protocol/armgate/protocol/vectors/README.md", "../SPEC.md", "spec.md"),
    ],
)
def test_links_lead_to_the_sites_pages(source: str, link: str, page: str) -> None:
    text = "see [it]({}), [`it`]({}) and `[code](../README.md)`"
    assert links.rewritten(text.format(link, link), source) == text.format(page, page)


def test_code_blocks_keep_their_links() -> None:
    block = "```md\n[a](../README.md)\n```\n"
    assert links.rewritten(block, "docs/gate.md") == block


def test_linked_files_become_pages() -> None:
    text = (
        "[a](../configs/demo.yaml) [b](gate.md) [c](../README.md) [d](https://example.org) [e](../none.txt)"
    )
    assert links.outside(text, "docs/x.md") == {"configs/demo.yaml"}
    assert "name: demo" in links.file_text("configs/demo.yaml")


@pytest.mark.parametrize("path", WITH_DIAGRAMS, ids=lambda path: path.stem)
def test_every_diagram_can_be_drawn(path: Path) -> None:
    drawn = diagrams.drawn(path.read_text(encoding="utf-8"))
    assert "```mermaid" not in drawn
    for svg in re.findall(r"<svg.*?</svg>", drawn, re.DOTALL):
        assert "\n\n" not in svg, "a blank line ends an HTML block in Markdown"
        ET.fromstring(svg)


def test_a_state_machine_shows_states_and_transitions() -> None:
    diagram = diagrams.parsed(
        "stateDiagram-v2\n    [*] --> free\n    free --> held: acquire\n    held --> [*]\n"
    )
    assert list(diagram.columns) == ["free", "held"]
    assert [(row.start, row.end, row.label) for row in diagram.rows] == [
        ("[*]", "free", "start"), ("free", "held", "acquire"), ("held", "[*]", "end"),
    ]  # fmt: skip


@pytest.mark.parametrize("text", ["pie\n", "sequenceDiagram\n  a ==> b\n", "stateDiagram-v2\n  a -> b\n"])
def test_a_diagram_that_cannot_be_drawn_is_an_error(text: str) -> None:
    with pytest.raises(diagrams.DiagramError, match="expected"):
        diagrams.parsed(text)


def site(folder: Path, body: str, style: str = "") -> Path:
    (folder / "index.html").write_text(f"<h1 id='a'>x</h1>{body}", encoding="utf-8")
    (folder / "other.html").write_text("<p id='b'>y</p>", encoding="utf-8")
    (folder / "site.css").write_text(style, encoding="utf-8")
    return folder


def test_a_site_that_loads_nothing_and_has_no_broken_link_passes(tmp_path: Path) -> None:
    body = (
        "<a href='other.html#b'></a><a href='#a'></a><a href='https://example.org'></a><img src='site.css'>"
    )
    assert [*check.findings(site(tmp_path, body, "a { background: url(x.png) }"))] == []


@pytest.mark.parametrize(
    ("body", "style", "found"),
    [
        ("<script src='https://example.org/x.js'></script>", "", "loads https://example.org/x.js"),
        ("<link href='//example.org/x.css' rel='stylesheet'>", "", "loads //example.org/x.css"),
        ("<img src='http://example.org/x.png'>", "", "loads http://example.org/x.png"),
        ("", "@import 'https://example.org/font.css';", "loads https://example.org/font.css"),
        ("", "a { background: url(https://example.org/x.png) }", "loads https://example.org/x.png"),
        ("<a href='none.html'></a>", "", "none.html leads nowhere"),
        ("<a href='other.html#c'></a>", "", "other.html#c leads to no anchor"),
        ("<pre class='mermaid'></pre>", "", "only a program from the network"),
    ],
)
def test_what_a_site_must_not_have_is_found(tmp_path: Path, body: str, style: str, found: str) -> None:
    (finding,) = check.findings(site(tmp_path, body, style))
    assert found in finding


def test_an_empty_site_is_found(tmp_path: Path) -> None:
    assert [*check.findings(tmp_path)] == [f"{tmp_path}: no pages"]
