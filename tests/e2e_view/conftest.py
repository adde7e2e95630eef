"""Fixtures: a daemon of the demo cell, a viewer in the operator role, and a browser for its page."""

import contextlib
import subprocess
import sys
from pathlib import Path

import pytest

from support.browsers import chromium

CONFIG = Path(__file__).parents[2] / "configs" / "demo.yaml"
ARMGATE = [sys.executable, "-m", "armgate.apps"]
PLAIN = ("--port", "0", "--no-meshes")
"""Any free port, and pictures that do not depend on installed extras."""


@contextlib.contextmanager
def process(*arguments, prints):
    """Run an ``armgate`` process; yield the rest of the line that begins with ``prints``, and the process."""
    child = subprocess.Popen(
        [*ARMGATE, *map(str, arguments)], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )
    try:
        line = child.stdout.readline()
        assert line.startswith(prints), line
        yield line.removeprefix(prints).strip(), child
    finally:
        if child.poll() is None:
            child.terminate()
            try:
                child.wait(30)
            except subprocess.TimeoutExpired:
                child.kill()
        child.communicate()


@pytest.fixture(scope="module")
def address():
    with process("serve", CONFIG, "--port", "0", prints="armgate: listening on ") as (found, _):
        yield found


@pytest.fixture(scope="module")
def viewing(address):
    with process("view", address, *PLAIN, "--role", "operator", prints="armgate: view at ") as (
        url,
        child,
    ):
        yield url
        child.terminate()
        assert child.wait(30) == 0


@pytest.fixture(scope="package")
def browser():
    with chromium() as made:
        yield made
