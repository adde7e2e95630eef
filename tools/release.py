"""Check of a release: ``python -m tools.release DIST``.

1. Build the source distribution, and the wheel from it.
2. Install the wheel without extras into an empty virtual environment.
3. Run the README's controller from there against a daemon of the working tree, until commands are admitted.

The working tree's environment (``make install``) provides the builder and the daemon.
"""

import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
import tomllib
import venv
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from armgate.client import connect

ROOT = Path(__file__).parents[1]
ADDRESS = "127.0.0.1:7411"
ENOUGH = 20
"""Number of admitted commands after which the controller is believed to work."""
_TIMEOUT = 120.0
"""Longest wait for the commands, s."""


class ReleaseError(Exception):
    """Release that must not be published."""


def main(dist: str) -> int:
    """Build and try a release, print the result, return the exit status."""
    try:
        wheel = build(Path(dist))
        with tempfile.TemporaryDirectory(prefix="armgate-release-") as folder:
            python = install(wheel, Path(folder) / "venv")
            _check_command(python, Path(folder))
            admitted = try_controller(python, Path(folder))
    except (ReleaseError, subprocess.CalledProcessError) as error:
        print(f"release-check: {error}", file=sys.stderr)
        return 1
    print(f"release-check: passed; {wheel.name} works in an empty environment, {admitted} commands admitted")
    return 0


def build(dist: Path) -> Path:
    """Return the wheel, built from the source distribution; both are in the folder afterwards."""
    dist.mkdir(parents=True, exist_ok=True)
    version = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    stem = f"armgate-{version}"
    out = str(dist.absolute())
    _run(sys.executable, "-m", "hatchling", "build", "-t", "sdist", "-d", out, folder=ROOT)
    with tempfile.TemporaryDirectory(prefix="armgate-sdist-") as folder:
        with tarfile.open(dist / f"{stem}.tar.gz") as archive:
            archive.extractall(folder, filter="data")
        source = Path(folder) / stem
        _run(sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", out, folder=source)
    wheel = dist / f"{stem}-py3-none-any.whl"
    if not wheel.is_file():
        raise ReleaseError(f"{wheel} was not built")
    return wheel


def install(wheel: Path, folder: Path) -> Path:
    """Return the interpreter of a new environment that holds the wheel and what it requires, nothing else."""
    venv.create(folder, with_pip=True)
    python = folder / "bin" / "python"
    pip = (python, "-I", "-m", "pip", "--quiet", "--disable-pip-version-check", "--no-input")
    _run(*pip, "install", wheel.absolute(), folder=folder)
    _run(*pip, "check", folder=folder)
    return python


def _check_command(python: Path, folder: Path) -> None:
    printed = _run(python.with_name("armgate"), "--version", folder=folder)
    version = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    if printed.strip() != f"armgate {version}":
        raise ReleaseError(f"armgate --version prints {printed.strip()!r}; expected version {version}")


def try_controller(python: Path, folder: Path) -> int:
    """Return how many commands of the README's controller the daemon admitted.

    Raises:
        ReleaseError: The controller ended, or its commands were not admitted in time.
    """
    with _daemon() as address:
        program = folder / "controller.py"
        program.write_text(readme_program().replace(ADDRESS, address), encoding="utf-8")
        controller = subprocess.Popen(  # noqa: S603
            [python, "-I", program], cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        )
        try:
            return _admitted(address, controller)
        finally:
            controller.kill()
            controller.communicate()


def _admitted(address: str, controller: subprocess.Popen[str]) -> int:
    with connect(address, name="release-check", role="observer") as cell:
        cell.subscribe(every=1)
        begin = None
        for state in cell.states():
            begin = state.time if begin is None else begin
            count = max((entry.counts or {}).get("admitted", 0) for entry in state.entries)
            if count >= ENOUGH:
                return count
            if controller.poll() is not None:
                raise ReleaseError(f"the controller ended: {controller.communicate()[1].strip()}")
            if state.time - begin > _TIMEOUT:
                raise ReleaseError(f"only {count} commands were admitted in {_TIMEOUT:g} s")
    raise ReleaseError("the daemon ended")


def readme_program() -> str:
    """Return the controller that the README shows."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    match = re.search(r"^```python\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    if match is None:
        raise ReleaseError("README.md shows no program")
    return match[1]


@contextmanager
def _daemon() -> Iterator[str]:
    """Run a daemon of the working tree and yield its address."""
    command = [sys.executable, "-m", "armgate.apps", "serve", "configs/demo.yaml", "--port", "0"]
    with subprocess.Popen(  # noqa: S603
        command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as daemon:
        assert daemon.stdout is not None
        try:
            line = daemon.stdout.readline()
            if not line.startswith("armgate: listening on "):
                raise ReleaseError(f"the daemon did not start: {line.strip()!r}")
            yield line.split()[-1]
        finally:
            daemon.terminate()


def _run(*command: object, folder: Path) -> str:
    """Return what a command prints; it must succeed."""
    words = [str(word) for word in command]
    if shutil.which(words[0]) is None:
        raise ReleaseError(f"{words[0]} does not exist")
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)  # noqa: S603
    if done.returncode:
        raise ReleaseError(f"{' '.join(words)}\n{done.stdout}{done.stderr}".strip())
    return done.stdout


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
