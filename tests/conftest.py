"""What holds for all tests."""

import signal

import pytest

from armgate.gate.clearance import compiled


def _ignore(_signum: int, _frame: object) -> None:
    """Ignore a signal by a handler, which children do not inherit."""


# nohup starts the tests with SIGHUP ignored, a shell's background with SIGINT ignored. Children inherit that,
# and tests that end a child by such a signal would wait for ever. A handler does not pass to a new program.
for _signal in (signal.SIGHUP, signal.SIGINT):
    if signal.getsignal(_signal) is signal.SIG_IGN:
        signal.signal(_signal, _ignore)


@pytest.fixture(scope="session", autouse=True)
def _kernels_in_the_cache():
    """Compiles the gate's kernels once, so that no daemon that a test starts does it while the test waits."""
    if compiled.available():
        compiled.prepare()
