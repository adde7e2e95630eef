"""A run with small scripts in place of daemon, leader and follower."""

import os
import queue
import signal
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from armgate.apps.demo.run import NAMES
from armgate.apps.demo.run import plan as demo_plan
from armgate.apps.errors import AppError, UsageError
from armgate.apps.stack import run as course
from armgate.apps.stack.child import INTERRUPTED
from armgate.apps.stack.failures import exit_error, stops_in
from armgate.apps.stack.monitoring import read_report
from armgate.apps.stack.plan import DAEMON, PRIORITIES, Plan
from armgate.apps.stack.processes import Children, Event, Exited, Interrupted, Printed
from armgate.apps.stack.robot_processes import RobotProcesses, robots_of
from armgate.apps.stack.run_folder import socket_in
from armgate.cell.config import load_config

PYTHON = (sys.executable, "-u", "-c")
GOOD = [*PYTHON, "pass"]
POLITE = [
    *PYTHON,
    "import signal\ntry: print('ready'); signal.pause()\nexcept KeyboardInterrupt: print('rested')",
]

TERMINATED = [
    *PYTHON,
    "import signal, sys\nsignal.signal(15, lambda *_: (print('terminated'), sys.exit()))\n"
    "print('ready')\nsignal.pause()",
]
FAILS_AT_THE_END = """
import signal, sys
signal.signal(signal.SIGTERM, lambda *_: sys.exit("armgate: recording: disk full"))
print("ready")
signal.pause()
"""


@pytest.fixture
def children(tmp_path: Path) -> Iterator[Children]:
    with Children(tmp_path) as children:
        yield children


def plan(**changes: Any) -> Plan:
    return demo_plan([Path("a.yaml"), Path("b.yaml")], Path("p.csv"), "GR", "FR", **changes)


def listening(children: Children) -> str:
    return course._printed(children, DAEMON, course.LISTENING)


def test_the_command_lines_of_a_plan() -> None:
    assert plan().daemon() == ["serve", "a.yaml", "b.yaml", "--port", "0"]
    assert plan(lockstep=True).daemon()[-2:] == ["--lockstep", "leader,follower"]
    lead = plan(duration=2.5).controller("leader", "h:1")
    assert lead == (
        ["lead", "h:1", "--robot", "GR", "--path", "p.csv", "--duration", "2.5", "--name", "leader"]
    )
    follow = plan(lag=0.12).controller("follower", "h:1")
    assert follow == (
        ["follow", "h:1", "--robot", "FR", "--leader", "GR", "--lag", "0.12", "--name", "follower"]
    )


def test_the_address_is_what_the_daemon_prints(children: Children) -> None:
    children.start("daemon", [*PYTHON, "print('warming up'); print('armgate: listening on 127.0.0.1:4711')"])
    assert listening(children) == "127.0.0.1:4711"


def test_a_run_in_a_used_folder_does_not_show_the_earlier_monitors_report(
    children: Children, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def connect(*_: object, **__: object) -> None:
        raise AppError("not connected")

    (tmp_path / "monitor.json").write_text('{"states": 7}')
    daemon = [*PYTHON, "print('armgate: listening on 127.0.0.1:4711')"]
    monkeypatch.setattr(children, "launch", lambda name, *_, **__: children.start(name, daemon))
    monkeypatch.setattr(course, "connect", connect)
    with pytest.raises(AppError, match="not connected"):
        course.run(children, replace(plan(), record=tmp_path), lambda _: None)
    assert read_report(tmp_path) is None


def test_a_daemon_that_cannot_start_is_reported_with_its_log(children: Children) -> None:
    children.start(
        "daemon", [*PYTHON, "import sys; print('armgate: port in use', file=sys.stderr); sys.exit(2)"]
    )
    with pytest.raises(AppError, match=r"(?s)the daemon ended \(2\).*daemon\.log ends with.*port in use"):
        listening(children)


def test_an_interrupt_ends_the_wait_for_the_daemon(children: Children) -> None:
    children.events.put(Interrupted(signal.SIGINT))
    with pytest.raises(AppError, match="interrupted before the daemon was ready"):
        listening(children)


def test_a_run_is_done_when_both_controllers_have_ended(children: Children) -> None:
    pictures: list[int] = []
    children.start("leader", GOOD)
    children.start("follower", GOOD)
    assert course._until_done(children, NAMES, lambda: pictures.append(1))
    assert pictures


def test_an_interrupted_run_is_incomplete_and_its_controllers_come_to_rest(children: Children) -> None:
    for name, script in (("daemon", TERMINATED), ("leader", POLITE), ("follower", POLITE)):
        children.start(name, script)
        assert children.next(30.0) == Printed(name, "ready")
    children.events.put(Interrupted(signal.SIGINT))
    assert not course._until_done(children, NAMES, lambda: None)
    assert course._rest(children, plan(), None) is None
    assert children.running() == []
    assert children.tail("leader")[-1] == "rested"
    assert children.tail("daemon")[-1] == "terminated"  # by SIGTERM, after the others


class SlowEnds(queue.SimpleQueue[Event]):
    """Queue in which the end of a child arrives after the child is gone."""

    def put(self, item: Event, *_: object) -> None:
        if isinstance(item, Exited):
            time.sleep(0.3)
        super().put(item)


@pytest.mark.slow
def test_a_failure_counts_if_its_event_follows_the_childs_end(children: Children) -> None:
    children.events = SlowEnds()
    for name in NAMES:
        children.start(name, [*PYTHON, "raise SystemExit(1)"])
    with pytest.raises(AppError, match=r"ended \(1\)"):
        course._until_done(children, NAMES, lambda: None)


def test_a_participant_that_is_stopped_ends_the_run(children: Children) -> None:
    children.start("leader", POLITE)
    children.start("follower", [*PYTHON, f"raise SystemExit({INTERRUPTED})"])
    with pytest.raises(AppError, match="the follower was interrupted before its work was done"):
        course._until_done(children, NAMES, lambda: None)


@pytest.mark.daily(1)
@pytest.mark.parametrize("name", ["robots", "krc-FR"])
def test_a_robot_server_or_virtual_robot_that_ends_by_itself_ends_the_run(
    children: Children, name: str
) -> None:
    robots = RobotProcesses(Path("s"), {"krc-FR": ["krc"]})
    children.start("leader", POLITE)
    children.start(name, GOOD)
    with pytest.raises(AppError, match=rf"the {name} ended \(0\)"):
        course._until_done(children, NAMES, lambda: None, course._needed(replace(plan(), robots=robots)))


def test_a_daemon_that_fails_while_it_ends_fails_the_run(children: Children) -> None:
    children.start("daemon", [*PYTHON, FAILS_AT_THE_END])
    assert children.next(30.0) == Printed("daemon", "ready")
    failure = course._rest(children, plan(), None)
    assert "the daemon ended (1)" in str(failure)
    assert "disk full" in str(failure)


def test_the_first_failure_is_the_one_that_is_reported(children: Children) -> None:
    children.start("daemon", [*PYTHON, FAILS_AT_THE_END])
    assert children.next(30.0) == Printed("daemon", "ready")
    first = AppError("the leader ended (1)")
    assert course._rest(children, plan(), first) is first


@pytest.mark.daily(1)
@pytest.mark.parametrize(
    ("code", "expected"),
    [
        ("import sys; print('lost the lease', file=sys.stderr); sys.exit(1)", r"ended \(1\).*lost the lease"),
        ("import os, signal; os.kill(os.getpid(), signal.SIGKILL)", "was killed by SIGKILL"),
    ],
)
def test_a_failed_controller_ends_the_run_and_is_named(children: Children, code: str, expected: str) -> None:
    children.start("leader", POLITE)
    children.start("follower", [*PYTHON, code])
    with pytest.raises(AppError, match=f"(?s)the follower {expected}"):
        course._until_done(children, NAMES, lambda: None)


@pytest.mark.slow
def test_a_daemon_that_ends_by_itself_ends_the_run(children: Children) -> None:
    children.start("leader", POLITE)
    children.start("daemon", GOOD)
    with pytest.raises(AppError, match=r"the daemon ended \(0\)"):
        course._until_done(children, NAMES, lambda: None)


def test_signals_become_an_event_and_the_second_one_ends_at_once(children: Children) -> None:
    before = signal.getsignal(signal.SIGTERM)
    with course.interruptions(children):
        os.kill(os.getpid(), signal.SIGTERM)
        assert children.next(30.0) == Interrupted(signal.SIGTERM)
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
    assert signal.getsignal(signal.SIGTERM) == before


@pytest.mark.parametrize("ignored", [False, True])
def test_a_hangup_ends_a_run_unless_its_parent_ignored_it(children: Children, ignored: bool) -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN if ignored else signal.SIG_DFL)
    try:
        with course.interruptions(children):
            os.kill(os.getpid(), signal.SIGHUP)
            assert children.next(0.0 if ignored else 30.0) == (
                None if ignored else Interrupted(signal.SIGHUP)
            )
    finally:
        signal.signal(signal.SIGHUP, before)


def test_the_error_of_a_child_names_its_status_or_signal(children: Children) -> None:
    children.log("leader").write_text("one\ntwo\n")
    text = str(exit_error(children, Exited("leader", 1)))
    assert text.splitlines()[-2:] == ["  | one", "  | two"]


LINKS = Path(__file__).parents[2] / "configs" / "links" / "rsi-virtual.yaml"


def test_virtual_krcs_follow_from_the_links(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    files = [LINKS.parents[1] / "demo.yaml", LINKS]
    robots = robots_of(load_config(files), files, Path("r"))
    assert robots is not None
    assert robots.server(files) == ["robot-server", *map(str, files), "--socket", "r/logs/robots.sock"]
    assert replace(plan(), robots=robots).daemon()[-2:] == ["--robot-server", "r/logs/robots.sock"]
    assert list(robots.virtual) == ["krc-FR", "krc-GR"]
    words = list(robots.virtual["krc-GR"])
    options = dict(zip(words[1::2], words[2::2], strict=True))
    assert (options["--profile"], options["--robot"], options["--cycle"]) == ("krc2-rsi2", "GR", "12")
    assert (options["--axiscorr"], options["--axiscorrmon"]) == ("A=400,E=4000", "A=401,E=4001")
    assert Path(options["--config"]).name == "gantry-correction.xml"
    assert robots_of(load_config(files[:1]), files[:1], tmp_path) is None


def test_the_demo_refuses_to_move_a_real_robot(tmp_path: Path) -> None:
    real = tmp_path / "real.yaml"
    real.write_text("armgate: 1\nrobots: {GR: {link: {virtual: null}}}\n")
    files = [LINKS.parents[1] / "demo.yaml", LINKS, real]
    with pytest.raises(UsageError, match="GR is a real robot"):
        robots_of(load_config(files), files, tmp_path)


def test_the_path_of_a_runs_socket_is_relative_if_that_is_shorter(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert socket_in(Path("run")) == Path("run/logs/robots.sock")
    assert socket_in(Path("/r")) == Path("/r/logs/robots.sock")
    assert socket_in(tmp_path / "run") == Path("run/logs/robots.sock")


def test_a_folder_too_long_for_a_socket_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UsageError, match=r"too long for the robot server's socket .*choose a shorter folder"):
        socket_in(Path("x" * 120))


def test_the_stops_of_a_failed_run_are_reported_with_their_reasons(tmp_path: Path) -> None:
    log = tmp_path / "daemon.log"
    assert stops_in(log) == ""
    log.write_text(
        'armgate: listening on 127.0.0.1:1\n{"event": "listening"}\n3\n'
        '{"event": "stopped", "robots": ["FR"], "reason": "no telegram for 0.1 s", "by": "gate"}\n'
    )
    assert stops_in(log) == "\n  FR stopped by gate: no telegram for 0.1 s"


def test_processes_nearer_to_the_robots_have_higher_priorities() -> None:
    assert plan().priority("robots") > plan().priority("daemon") > plan().priority("controller") > 0
    assert {plan(lockstep=True).priority(what) for what in PRIORITIES} == {0}


def test_the_speed_counts_from_the_second_state() -> None:
    span = course.Span()
    assert span.factor is None
    for elapsed, wall in ((0.0, 100.0), (0.06, 107.0), (0.12, 107.01), (4.06, 107.5)):
        span.note(elapsed, wall)
    assert span.factor == pytest.approx(8.0)
    assert span.wall == pytest.approx(0.5)
