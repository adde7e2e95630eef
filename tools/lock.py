"""Writer of the lock files: exact versions and SHA-256 hashes of every file, resolved by uv.

``python -m tools.lock UV [FILE…]`` renews all lock files or some. Addresses of package indexes and paths of
this machine are left out, so a lock file is used with the index that pip is configured for.
"""

import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
_OPTIONS = ("--quiet", "--generate-hashes", "--no-header", "--no-annotate")


@dataclass(frozen=True)
class Lock:
    """Lock file, and its sources."""

    file: str
    purpose: str
    use: str
    source: str = "pyproject.toml"
    extras: tuple[str, ...] = ()

    @property
    def path(self) -> Path:
        """Place of the lock file."""
        return ROOT / self.file

    @property
    def header(self) -> str:
        """Comment at its beginning."""
        first = f"# {self.purpose}: exact versions, and SHA-256 of files."
        return f"{first}\n#   {self.use}\n# Renew it with: make lock\n"


SERVICE = Lock(
    "requirements.lock",
    "Requirements of a service of this release",
    "pip install --require-hashes -r requirements.lock && pip install --no-deps armgate",
    extras=("cell", "fast", "plots", "sign", "view"),
)
DEVELOPMENT = Lock(
    "requirements-dev.lock",
    "Requirements for development and tests of this release",
    "pip install --require-hashes -r requirements-dev.lock && pip install --no-deps --editable .",
    extras=("bench", "cell", "dask", "env", "fast", "gamepad", "lint", "plots", "sign", "test", "view"),
)
SITE = Lock(
    "tools/site/requirements.lock",
    "Requirements to build the documentation's site",
    "make docs",
    source="tools/site/requirements.in",
)
LOCKS = (SERVICE, DEVELOPMENT, SITE)


def main(uv: str, *files: str) -> None:
    """Resolve the requirements and write the lock files."""
    for lock in LOCKS:
        if not files or lock.file in files:
            lock.path.write_text(lock.header + "".join(resolved(lock, uv)), encoding="utf-8")
            print(lock.file)


def resolved(lock: Lock, uv: str) -> list[str]:
    """Return the entries of a lock file, resolved anew."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "requirements.txt"
        extras = [word for extra in lock.extras for word in ("--extra", extra)]
        command: list[str] = [
            uv,
            "pip",
            "compile",
            *_OPTIONS,
            "--python",
            sys.executable,
            *extras,
            "--output-file",
            str(out),
        ]
        subprocess.run([*command, lock.source], cwd=ROOT, check=True)  # noqa: S603
        return entries(out.read_text(encoding="utf-8"))


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
