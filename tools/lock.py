"""Renews ``requirements.lock``: all that a service needs, with exact versions and SHA-256 of every file.

``python -m tools.lock PIP_COMPILE``. Names of package indexes and paths of this machine are left out.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
LOCK = ROOT / "requirements.lock"
EXTRAS = ("cell", "fast", "plots", "sign", "view")
_OPTIONS = (
    "--quiet", "--generate-hashes", "--allow-unsafe", "--strip-extras", "--no-header", "--no-annotate",
    "--no-emit-index-url", "--no-emit-find-links", "--no-emit-trusted-host",
)  # fmt: skip
HEADER = f"""\
# What armgate[{",".join(EXTRAS)}] was released with: exact versions, and SHA-256 of files.
#   pip install --require-hashes -r requirements.lock && pip install --no-deps armgate
# Renew it with: make lock
"""


def main(pip_compile: str) -> None:
    """Resolve the requirements and write the lock file."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "requirements.txt"
        extras = [word for extra in EXTRAS for word in ("--extra", extra)]
        command = [pip_compile, *_OPTIONS, *extras, "--output-file", str(out), "pyproject.toml"]
        subprocess.run(command, cwd=ROOT, check=True)  # noqa: S603
        LOCK.write_text(HEADER + "".join(entries(out.read_text())), encoding="utf-8")


def entries(text: str) -> list[str]:
    """Return the entries of a requirements file, without comments and without armgate itself."""
    found: list[str] = []
    for line in text.splitlines(keepends=True):
        if line.startswith(" ") and found:
            found[-1] += line
        elif line.strip() and not line.startswith("#"):
            found.append(line)
    return [entry for entry in found if not entry.startswith("armgate ")]


if __name__ == "__main__":
    main(*sys.argv[1:])
