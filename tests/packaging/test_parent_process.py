"""Tests give the same results under every parent: a terminal, nohup, the background of a shell."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PROBE = (
    "import signal; print(*(signal.getsignal(s) is signal.SIG_IGN for s in (signal.SIGHUP, signal.SIGINT)))"
)
SAME = f"{Path(__file__).relative_to(ROOT)}::test_children_of_tests_ignore_no_signal"


def test_children_of_tests_ignore_no_signal() -> None:
    probe = subprocess.run([sys.executable, "-c", PROBE], capture_output=True, text=True, check=True)
    assert probe.stdout == "False False\n"


@pytest.mark.slow
def test_children_of_tests_ignore_no_signal_if_the_parent_ignores_hangup_and_interrupt() -> None:
    def ignore() -> None:
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
        signal.signal(signal.SIGINT, signal.SIG_IGN)

    bare = subprocess.run(
        [sys.executable, "-c", PROBE], preexec_fn=ignore, capture_output=True, text=True, check=True
    )
    assert bare.stdout == "True True\n"  # a child inherits ignored signals
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", SAME],
        preexec_fn=ignore, capture_output=True, text=True, check=False, cwd=ROOT, timeout=120,
        env={key: value for key, value in os.environ.items() if not key.startswith("PYTEST_")},
    )  # fmt: skip
    assert done.returncode == 0, done.stdout
