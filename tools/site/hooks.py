"""Hooks of MkDocs: pages from outside of ``docs/``, links into the repository, diagrams, search in files."""

from pathlib import Path
from typing import Any

from mkdocs.structure.files import File

from tools.site import diagrams, links

_ORIGIN = {page: document for document, page in links.DOCUMENTS.items() if page != "index.md"}


def on_files(files: Any, config: Any) -> Any:
    """Add the documents from outside of ``docs/`` and every file that a page links to."""
    for page, document in _ORIGIN.items():
        text = (links.ROOT / document).read_text(encoding="utf-8")
        files.append(File.generated(config, page, content=text))
    linked = set()
    for file in files.documentation_pages():
        linked |= links.outside(file.content_string, _source(file.src_uri))
    for path in sorted(linked):
        files.append(File.generated(config, links.file_page(path), content=links.file_text(path)))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Return the page with links that work on the site, and with its diagrams drawn."""
    page.meta["search"] = {"boost": _boost(page.file.src_uri)}
    source = _source(page.file.src_uri)
    if source.startswith("files/"):
        return markdown
    return diagrams.drawn(links.rewritten(markdown, source))


def on_post_build(config: Any) -> None:
    """Write the search index as a script, too: pages that are opened as files cannot read anything else."""
    folder = Path(config["site_dir"]) / "search"
    index = (folder / "search_index.json").read_text(encoding="utf-8")
    (folder / "search_index.js").write_text(f"var __index = {index}", encoding="utf-8")


on_post_build.mkdocs_priority = -100  # type: ignore[attr-defined]  # after the search plugin


def _boost(page: str) -> float:
    """Return the weight of a page in the search: pages that explain come before files and release notes."""
    if page == "changelog.md" or page.startswith("files/"):
        return 0.1
    return 3.0 if page == "configuration-reference.md" else 1.0


def _source(page: str) -> str:
    """Return the path in the repository of a page's file."""
    if page.startswith("files/"):
        return page
    return _ORIGIN.get(page, f"docs/{page}")
