"""Children are observed by events and never left running."""

import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from armgate.apps.interrupt import Interrupt
from armgate.apps.stack import child
from armgate.apps.stack.processes import Children, Event, Exited, Interrupted, Printed

PYTHON = (sys.executable, "-u", "-c")
WAIT = 30.0
STUBBORN = """
import signal, sys
signal.signal(signal.SIGTERM, signal.SIG_IGN)
print("ready")
signal.pause()
"""


@pytest.fixture
def children(tmp_path: Path) -> Iterator[Children]:
    with Children(tmp_path) as children:
        yield children


def expect(children: Children, kind: type[Event]) -> Event:
    while (event := children.next(WAIT)) is not None:
        if isinstance(event, kind):
            return event
    raise AssertionError(f"no {kind.__name__} in {WAIT:g} s")


def test_lines_and_the_exit_come_as_events_and_both_streams_go_into_the_log(children: Children) -> None:
    children.start("child", [*PYTHON, "import sys; print('hello'); sys.stderr.write('oh\\n'); sys.exit(3)"])
    assert children.next(WAIT) == Printed("child", "hello")
    assert expect(children, Exited) == Exited("child", 3)
    assert sorted(children.tail("child")) == ["hello", "oh"]
    assert children.log("child").stat().st_mode & 0o077 == 0  # the viewer prints the token of its page
    assert children.running() == []


def test_next_returns_none_after_the_timeout(children: Children) -> None:
    assert children.next(0.0) is None


def test_signals_reach_only_named_and_running_children(children: Children) -> None:
    for name in ("one", "two"):
        children.start(name, [*PYTHON, "import signal; print('ready'); signal.pause()"])
        expect(children, Printed)
    children.send(signal.SIGTERM, "one")
    assert expect(children, Exited) == Exited("one", -signal.SIGTERM)
    assert children.running() == ["two"]
    children.send(signal.SIGTERM, "one", "two")
    assert children.wait(["one", "two"], WAIT) == []


def test_children_do_not_get_the_terminals_interrupt(children: Children) -> None:
    children.start("child", [*PYTHON, "import os; print(os.getpgrp())"])
    event = expect(children, Printed)
    assert isinstance(event, Printed)
    assert int(event.text) != os.getpgrp()


def test_leaving_the_context_kills_running_children(tmp_path: Path) -> None:
    with Children(tmp_path) as children:
        children.start("stubborn", [*PYTHON, STUBBORN])
        assert expect(children, Printed) == Printed("stubborn", "ready")
        children.send(signal.SIGTERM)
        assert children.wait(["stubborn"], 0.0) == ["stubborn"]
    assert children.running() == []
    assert children.next(0.0) == Exited("stubborn", -signal.SIGKILL)


def test_the_tail_is_the_end_of_the_log(children: Children) -> None:
    children.start("child", [*PYTHON, "for i in range(100): print(i)"])
    expect(children, Exited)
    assert children.tail("child") == [str(i) for i in range(88, 100)]


def test_an_event_from_a_signal_handler(children: Children) -> None:
    children.events.put(Interrupted(signal.SIGINT))
    assert children.next(WAIT) == Interrupted(signal.SIGINT)


def test_children_become_real_time_processes_if_allowed(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []
    monkeypatch.setattr(os, "sched_setscheduler", lambda *how: calls.append(how))
    child.set_priority(0)
    child.set_priority(7)
    ((_, policy, param),) = calls
    assert policy == os.SCHED_RR | os.SCHED_RESET_ON_FORK
    assert param.sched_priority == 7

    def refuse(*_: object) -> None:
        raise PermissionError

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    child.set_priority(7)


@pytest.mark.parametrize(("requested", "status"), [(False, 0), (True, child.INTERRUPTED)])
def test_a_child_reports_that_a_signal_ended_it(
    monkeypatch: pytest.MonkeyPatch, requested: bool, status: int
) -> None:
    monkeypatch.setattr(child, "main", lambda _: sys.exit(0))
    monkeypatch.setattr(Interrupt, "ever_requested", requested)
    with pytest.raises(SystemExit) as end:
        child.run_command(["lead"])
    assert end.value.code == status


def test_a_failed_child_keeps_its_status_after_a_signal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(child, "main", lambda _: sys.exit(1))
    monkeypatch.setattr(Interrupt, "ever_requested", True)
    with pytest.raises(SystemExit) as end:
        child.run_command(["lead"])
    assert end.value.code == 1
