"""The SDK and the command line work without the libraries of the cell and of the plots."""

import subprocess
import sys

import pytest

HEAVY = ("pinocchio", "pin", "coal", "hppfcl", "fcl", "matplotlib")

# Run in a process of its own: this one may have imported the heavy libraries already.
BLOCKER = f"""
import sys

class Blocker:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {HEAVY!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}} (blocked)", name=name)

sys.meta_path.insert(0, Blocker())
"""


def run_light(code: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", BLOCKER + code], capture_output=True, text=True, check=False)


def test_the_blocker_blocks() -> None:
    done = run_light("import pinocchio")
    assert done.returncode != 0
    assert "blocked" in done.stderr


@pytest.mark.daily(4)
@pytest.mark.parametrize(
    "module",
    [
        "armgate.protocol",
        "armgate.protocol.messages",
        "armgate.client",
        "armgate.client.aio",
        "armgate.client.blocking",
        "armgate.cell.config",
        "armgate.events",
        "armgate.apps.cli",
        "armgate.conformance.command",
        "armgate.conformance.run",
    ],
)
def test_a_module_for_controllers_imports_without_the_cells_libraries(module: str) -> None:
    done = run_light(f"import {module}")
    assert done.returncode == 0, done.stderr


def test_help_needs_no_heavy_library() -> None:
    code = "from armgate.apps.cli import main\nsys.argv = ['armgate', '--help']\nmain()"
    done = run_light(code)
    assert done.returncode == 0, done.stderr
    for command in ("serve", "check", "demo", "lead", "follow", "krc", "reach", "ellipsoid", "conformance"):
        assert command in done.stdout


@pytest.mark.daily(2)
@pytest.mark.parametrize(
    "command", ["serve", "check", "demo", "lead", "follow", "krc", "reach", "ellipsoid", "conformance"]
)
def test_a_commands_help_needs_no_heavy_library(command: str) -> None:
    code = f"from armgate.apps.cli import main\nsys.argv = ['armgate', {command!r}, '--help']\nmain()"
    done = run_light(code)
    assert done.returncode == 0, done.stderr
    assert "--help" in done.stdout
