"""A daemon of the demo cell, a viewer as its operator, and a browser that looks at its page."""

import contextlib
import subprocess
import sys
from pathlib import Path

import pytest

from support.browsers import chromium

CONFIG = Path(__file__).parents[2] / "configs" / "demo.yaml"
ARMGATE = [sys.executable, "-m", "armgate.apps"]
PLAIN = ("--port", "0", "--no-meshes")
"""On any free port, and the same pictures whatever is installed."""


@contextlib.contextmanager
def process(*arguments, says):
    """An ``armgate`` process that has said so; what followed it in that line."""
    child = subprocess.Popen(
        [*ARMGATE, *map(str, arguments)], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )
    try:
        line = child.stdout.readline()
        assert line.startswith(says), line
        yield line.removeprefix(says).strip(), child
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
    with process("serve", CONFIG, "--port", "0", says="armgate: listening on ") as (found, _):
        yield found


@pytest.fixture(scope="module")
def viewing(address):
    with process("view", address, *PLAIN, "--role", "operator", says="armgate: view at ") as (
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
