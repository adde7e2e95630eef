"""Generator of the files derived from the code: the tables of SPEC.md, the JSON Schema, the vectors.

python -m tools.spec            # write the files
python -m tools.spec --check    # compare only; exit status 1 if a file differs
"""

import sys
from pathlib import Path

import armgate.protocol
from tools.spec.schema import schema
from tools.spec.tables import BLOCKS, filled
from tools.spec.vectors import FILES

HOME = Path(armgate.protocol.__file__).parent


def products() -> dict[Path, str]:
    """Return every generated file with its content."""
    spec = HOME / "SPEC.md"
    vectors = {HOME / "vectors" / name: made() for name, made in FILES.items()}
    return {
        spec: filled(spec.read_text(encoding="utf-8"), BLOCKS),
        HOME / "schema.json": schema(),
    } | vectors


def main(arguments: list[str]) -> int:
    """Write or compare the files; return the exit status."""
    if arguments not in ([], ["--check"]):
        print(__doc__, file=sys.stderr)
        return 2
    differing = {path: text for path, text in products().items() if _read(path) != text}
    if arguments:
        for path in differing:
            print(f"{path}: differs from the code; run: make spec", file=sys.stderr)
        return 1 if differing else 0
    for path, text in differing.items():
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")
        print(path)
    return 0


def _read(path: Path) -> str | None:
    return path.read_text(encoding="utf-8") if path.exists() else None


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
