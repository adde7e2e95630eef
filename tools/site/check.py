"""Check of the built site: ``python -m tools.site.check FOLDER``.

A page may load nothing from the network. Every link inside the site must lead to a page and an anchor that
exist. No diagram may need a program that the site does not contain. Links that a reader follows may lead
anywhere.
"""

import re
import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

_LOADED = {"script": "src", "img": "src", "iframe": "src", "source": "src", "video": "src", "link": "href"}
_OPENED = {"a": "href"}
_STYLE = re.compile(r"url\(\s*['\"]?\s*((?:https?:)?//[^)'\"]+)|@import\s+['\"]((?:https?:)?//[^'\"]+)")
_QUIET_LINKS = {"canonical", "prev", "next"}


class Page(HTMLParser):
    """Anchors, loaded files and links of one page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.anchors: set[str] = set()
        self.loaded: list[str] = []
        self.links: list[str] = []
        self.classes: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Keep what a tag names, loads or links to."""
        given = {name: value or "" for name, value in attrs}
        self.anchors |= {given[name] for name in ("id", "name") if name in given}
        self.classes |= set(given.get("class", "").split())
        if tag == "link" and given.get("rel") in _QUIET_LINKS:
            return
        if tag in _LOADED and _LOADED[tag] in given:
            self.loaded.append(given[_LOADED[tag]])
        if tag in _OPENED and _OPENED[tag] in given:
            self.links.append(given[_OPENED[tag]])


def findings(site: Path) -> Iterator[str]:
    """Yield the faults of a site; each text begins with the file."""
    pages = {path: Page(path.read_text(encoding="utf-8")) for path in sorted(site.rglob("*.html"))}
    if not pages:
        yield f"{site}: no pages"
    for path, page in pages.items():
        for text in _of_page(site, path, page, pages):
            yield f"{path.relative_to(site)}: {text}"
    for path in sorted(site.rglob("*.css")):
        for match in _STYLE.finditer(path.read_text(encoding="utf-8")):
            yield f"{path.relative_to(site)}: loads {match[1] or match[2]} from the network"


def _of_page(site: Path, path: Path, page: Page, pages: dict[Path, Page]) -> Iterator[str]:
    yield from (f"loads {name} from the network" for name in page.loaded if urlsplit(name).netloc)
    if "mermaid" in page.classes:
        yield "has a diagram that only a program from the network can draw"
    for link in [*page.links, *page.loaded]:
        parts = urlsplit(link)
        if parts.scheme or parts.netloc:
            continue
        target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
        target = target / "index.html" if target.is_dir() else target
        if path.name == "404.html" and parts.path.startswith("/"):
            continue
        if not target.is_file():
            yield f"{link} leads nowhere"
        elif parts.fragment and target in pages and unquote(parts.fragment) not in pages[target].anchors:
            yield f"{link} leads to no anchor"


def main(site: str) -> int:
    """Print the findings and return the exit status."""
    found = [*findings(Path(site).resolve())]
    print(*found, sep="\n", end="\n" if found else "")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
