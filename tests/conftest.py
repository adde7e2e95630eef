"""Fixtures of all tests."""

import signal
from pathlib import Path

import pytest

_WITHOUT_GATE = {"cell", "client", "control", "emulator", "protocol", "recording"}
"""Folders of tests that neither use the gate nor start a daemon."""


def _ignore(_signum: int, _frame: object) -> None:
    """Ignore a signal by a handler, which children do not inherit."""


# nohup starts the tests with SIGHUP ignored, a shell's background with SIGINT ignored. Children inherit that,
# and tests that end a child by such a signal would wait for ever. A handler does not pass to a new program.
for _signal in (signal.SIGHUP, signal.SIGINT):
    if signal.getsignal(_signal) is signal.SIG_IGN:
        signal.signal(_signal, _ignore)


@pytest.fixture(autouse=True)
def _compiled_gate_if_used(request):
    if request.path.relative_to(Path(__file__).parent).parts[0] not in _WITHOUT_GATE:
        request.getfixturevalue("compiled_gate")


@pytest.fixture(scope="session")
def compiled_gate():
    """Compile the gate's kernels once, so that no daemon of a test compiles them while the test waits."""
    from armgate.gate.clearance import compiled

    if compiled.available():
        compiled.prepare()
