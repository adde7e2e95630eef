"""Links of a Markdown page, rewritten from the repository's layout to the site's.

Pages of ``docs/`` keep their place. Documents elsewhere, such as the specification, are pages of the site,
too (``DOCUMENTS``). Any other file that a page links to is shown on a page of its own, below ``files/``.
"""

import posixpath
import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
SPEC = "protocol/armgate/protocol"
DOCUMENTS = {
    "README.md": "index.md",
    f"{SPEC}/SPEC.md": "spec.md",
    f"{SPEC}/vectors/README.md": "vectors.md",
    "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
    "SECURITY.md": "reporting.md",
    "CODE_OF_CONDUCT.md": "code-of-conduct.md",
}
"""Documents outside of ``docs/`` and the pages that show them; the README's place is taken by the index."""
_TOKEN = re.compile(
    r"^(?P<fence>```|~~~).*?^(?P=fence)[ \t]*$"  # code comes first where it begins first
    r"|(?P<head>!?\[(?:[^\[\]]|\[[^\]]*\])*\]\()(?P<target>[^)\s]+)(?P<tail>[^)]*\))"
    r"|`[^`\n]+`",
    re.MULTILINE | re.DOTALL,
)
"""Code block, link, or code between backquotes."""
_LANGUAGES = {".py": "python", ".yaml": "yaml", ".toml": "toml", ".json": "json", ".sh": "sh", ".xml": "xml"}


def rewritten(markdown: str, source: str) -> str:
    """Return a page whose relative links work on the site.

    Args:
        markdown: Text of the page.
        source: Path of its file in the repository.
    """

    def replaced(match: re.Match[str]) -> str:
        if match["target"] is None:
            return match[0]
        return match["head"] + _on_site(match["target"], source) + match["tail"]

    return _TOKEN.sub(replaced, markdown)


def outside(markdown: str, source: str) -> set[str]:
    """Return the files outside of ``docs/`` to which a page links and which are no page by themselves."""
    targets = (match["target"] for match in _TOKEN.finditer(markdown) if match["target"])
    paths = {path for target in targets if (path := _in_repository(target, source))}
    return {
        path
        for path in paths
        if path not in DOCUMENTS and not path.startswith("docs/") and (ROOT / path).is_file()
    }


def file_page(path: str) -> str:
    """Return the name of the page that shows a file of the repository."""
    return f"files/{path}.md"


def file_text(path: str) -> str:
    """Return the page that shows a file of the repository."""
    language = _LANGUAGES.get(Path(path).suffix, "text")
    text = (ROOT / path).read_text(encoding="utf-8")
    return f"# {path}\n\n````{language}\n{text.rstrip()}\n````\n"


def page_of(source: str) -> str:
    """Return the name of the page that a document of the repository becomes."""
    return DOCUMENTS.get(source, source.removeprefix("docs/"))


def _in_repository(target: str, source: str) -> str | None:
    """Return the path of a link's target in the repository, or None for an address or an anchor."""
    name = target.partition("#")[0]
    if not name or re.match(r"[a-z]+:", target):
        return None
    return posixpath.normpath(posixpath.join(posixpath.dirname(source), name))


def _on_site(target: str, source: str) -> str:
    path = _in_repository(target, source)
    if path is None:
        return target
    if path in DOCUMENTS or path.startswith("docs/"):
        page = page_of(path)
    elif (ROOT / path).is_file():
        page = file_page(path)
    else:
        return target
    _, mark, anchor = target.partition("#")
    return posixpath.relpath(page, posixpath.dirname(page_of(source)) or ".") + mark + anchor
