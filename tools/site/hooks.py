"""Hooks of MkDocs: pages from outside of ``docs/``, links to files of the repository, diagrams as SVG."""

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
    """Return the page with links that hold on the site, and with its diagrams drawn."""
    source = _source(page.file.src_uri)
    if source.startswith("files/"):
        return markdown
    return diagrams.drawn(links.rewritten(markdown, source))


def _source(page: str) -> str:
    """Return the path in the repository of a page's file."""
    if page.startswith("files/"):
        return page
    return _ORIGIN.get(page, f"docs/{page}")
