"""Lint of English: find words and sentences that a reader would have to decode.

    python -m tools.words [--counts] [PATH…]

Without PATH the whole repository is read. Python files are searched for docstrings that begin with a bare
clause ("Whether", "Who", "What", …) and for idioms in docstrings, comments, texts and names of functions.
Markdown files are searched for idioms and for sentences of more than 40 words. Findings are printed one a
line, then their number by folder; ``--counts`` prints the numbers only. The exit status is 1 if there is a
finding.
"""

import argparse
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from tools.words.finding import Finding
from tools.words.markdown import markdown_findings
from tools.words.python import python_findings

ROOT = Path(__file__).parents[2]
PORTIONS = ("protocol", "sim", "server", "client")
FOLDERS = (*PORTIONS, "configs", "docs", "examples", "tools", "benchmarks", "tests", ".github")
EXEMPT = {"docs/glossary.md", "tools/words/idioms.py", "tests/packaging/test_words.py"}
"""Files that list the idioms."""
_SKIPPED = {"__pycache__", "out", ".venv"}


def main(arguments: list[str]) -> int:
    """Print the findings and return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m tools.words")
    parser.add_argument("paths", nargs="*", type=Path, metavar="PATH", help="files or folders to read")
    parser.add_argument("--counts", action="store_true", help="print the numbers only")
    args = parser.parse_args(arguments)
    missing = [str(path) for path in args.paths if not path.exists()]
    if missing:
        print(f"words: no such file or folder: {', '.join(missing)}", file=sys.stderr)
        return 2
    paths = args.paths or [*sorted(ROOT.glob("*.md")), *(ROOT / name for name in FOLDERS)]
    files = [*_files(paths)]
    found = [(path, finding) for path in files for finding in findings(path)]
    if not found:
        print(f"words: no findings in {len(files)} files")
        return 0
    if not args.counts:
        print(*(f"{_shown(path)}:{f.line}: {f.kind}: {f.text}" for path, f in found), sep="\n")
    _summary(found)
    return 1


def findings(path: Path) -> list[Finding]:
    """Return the findings of one file, by line."""
    text = path.read_text(encoding="utf-8")
    found = python_findings(text) if path.suffix == ".py" else markdown_findings(text)
    return sorted(found)


def _files(paths: list[Path]) -> Iterator[Path]:
    for path in paths:
        inside = sorted(path.rglob("*")) if path.is_dir() else [path]
        yield from (file for file in inside if file.suffix in {".py", ".md"} and not _skipped(file))


def _skipped(file: Path) -> bool:
    return bool(_SKIPPED & set(file.parts)) or _shown(file) in EXEMPT


def _shown(path: Path) -> str:
    absolute = path.resolve()
    return str(absolute.relative_to(ROOT)) if absolute.is_relative_to(ROOT) else str(path)


def _summary(found: list[tuple[Path, Finding]]) -> None:
    counts = Counter((_area(_shown(path)), finding.kind) for path, finding in found)
    kinds = ("docstring", "idiom", "name", "long sentence")
    print(f"{'area':28}" + "".join(f"{kind:>15}" for kind in kinds))
    for area in sorted({area for area, _ in counts}):
        print(f"{area:28}" + "".join(f"{counts[area, kind]:15}" for kind in kinds))
    total = Counter(finding.kind for _, finding in found)
    print(f"{'all':28}" + "".join(f"{total[kind]:15}" for kind in kinds))


def _area(path: str) -> str:
    """Return the package, or the folder, to which a file belongs."""
    parts = path.split("/")
    depth = 3 if parts[0] in PORTIONS else 2 if parts[0] == "tests" else 1
    return "/".join(parts[: min(depth, max(len(parts) - 1, 1))])


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
