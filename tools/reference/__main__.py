"""Writer of the reference pages that are generated from the code.

    python -m tools.reference            # write
    python -m tools.reference --check    # compare only; 1 if a page is out of date

The pages are ``docs/cli.md``, from the commands' signatures and docstrings, and
``docs/configuration-reference.md``, from the configuration's models.
"""

import sys
from pathlib import Path

from tools.reference.cli import command_line
from tools.reference.configuration import configuration

DOCS = Path(__file__).parents[2] / "docs"


def pages() -> dict[Path, str]:
    """Return the text of every generated page."""
    return {
        DOCS / "cli.md": command_line(),
        DOCS / "configuration-reference.md": configuration(),
    }


def main(arguments: list[str]) -> int:
    """Write or compare the pages and return the exit status."""
    if arguments not in ([], ["--check"]):
        print(__doc__, file=sys.stderr)
        return 2
    outdated = {
        path: text for path, text in pages().items() if not path.exists() or path.read_text("utf-8") != text
    }
    for path, text in outdated.items():
        if arguments:
            print(f"{path}: differs from the code; run: make reference", file=sys.stderr)
        else:
            path.write_text(text, encoding="utf-8")
            print(path)
    return 1 if arguments and outdated else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
