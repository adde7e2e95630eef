"""Fixtures and marks of all tests."""

import signal
from collections import defaultdict
from pathlib import Path

import pytest

_TESTS = Path(__file__).parent

_ALONE = (
    "conformance/test_fault_injection",
    "conformance/test_right_server",
    "daemon/metrics/test_http_server",
    "daemon/sessions/test_read_time",
    "daemon/sessions/test_slow_readers",
    "e2e/test_abuse",
    "e2e/test_robot_server",
    "e2e/test_rsi_faults",
    "e2e_view",
    "emulator/krc/test_krc_process",
    "emulator/krc/test_krc_real_time",
    "links/rsi/test_rsi_udp",
    "links/test_unread_ticks",
    "monitor/test_live.py",
    "packaging/test_tutorials",
)
"""Tests that depend on elapsed time or use both cores. They run one at a time."""

_WITHOUT_GATE = {"cell", "control", "emulator", "recording"}
"""Folders of tests that neither use the gate nor start a daemon."""


def _ignore(_signum: int, _frame: object) -> None:
    """Ignore a signal by a handler, which children do not inherit."""


# nohup starts the tests with SIGHUP ignored, a shell's background with SIGINT ignored. Children inherit that,
# and tests that end a child by such a signal would wait for ever. A handler does not pass to a new program.
for _signal in (signal.SIGHUP, signal.SIGINT):
    if signal.getsignal(_signal) is signal.SIG_IGN:
        signal.signal(_signal, _ignore)


def pytest_ignore_collect(collection_path, config):
    """Read only the files with tests that run alone if `-m` selects no others: reading all takes seconds."""
    others = config.option.markexpr.split()[-2:] != ["and", "alone"]
    if others or not collection_path.name.startswith("test_"):
        return None
    return not _runs_alone(collection_path) or None


def _runs_alone(path):
    return path.relative_to(_TESTS).as_posix().startswith(_ALONE)


@pytest.hookimpl(tryfirst=True)  # before `-m` chooses by marks
def pytest_collection_modifyitems(items):
    """Mark tests that run alone, and, as slow, all but n parameter sets of a test marked ``daily(n)``."""
    families = defaultdict(list)
    for item in items:
        if _runs_alone(item.path):
            item.add_marker("alone")
        if item.get_closest_marker("daily"):
            families[item.path, item.originalname].append(item)
    for family in families.values():
        (count,) = family[0].get_closest_marker("daily").args
        kept = {len(family) * k // count for k in range(count)}
        for k, item in enumerate(family):
            if k not in kept:
                item.add_marker("slow")


@pytest.fixture(autouse=True)
def _compiled_gate_if_used(request):
    if request.path.relative_to(_TESTS).parts[0] not in _WITHOUT_GATE:
        request.getfixturevalue("compiled_gate")


@pytest.fixture(scope="session")
def compiled_gate():
    """Compile the gate's kernels once, so that no daemon of a test compiles them while the test waits."""
    from armgate.gate import prepare

    prepare()
