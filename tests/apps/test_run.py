"""The course of a run, with small scripts in the places of daemon, leader and follower."""

import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from armgate.apps.demo.plan import NAMES
from armgate.apps.demo.plan import plan as demo_plan
from armgate.apps.errors import AppError, UsageError
from armgate.apps.stack import run as course
from armgate.apps.stack.processes import Asked, Crew, Exited, Printed
from armgate.apps.stack.robots import robots_of
from armgate.cell.config import load_config

PYTHON = (sys.executable, "-u", "-c")
GOOD = [*PYTHON, "pass"]
POLITE = [
    *PYTHON,
    "import signal; print('ready')\ntry: signal.pause()\nexcept KeyboardInterrupt: print('rested')",
]


@pytest.fixture
def crew(tmp_path: Path) -> Iterator[Crew]:
    with Crew(tmp_path) as crew:
        yield crew


def plan(**changes: Any) -> course.Plan:
    return demo_plan([Path("a.yaml"), Path("b.yaml")], Path("p.csv"), "GR", "FR", **changes)


def listening(crew: Crew) -> str:
    return course._printed(crew, course.DAEMON, course.LISTENING)


def test_the_commands() -> None:
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


def test_the_address_is_what_the_daemon_prints(crew: Crew) -> None:
    crew.start("daemon", [*PYTHON, "print('warming up'); print('armgate: listening on 127.0.0.1:4711')"])
    assert listening(crew) == "127.0.0.1:4711"


def test_a_daemon_that_cannot_start_is_told_with_its_log(crew: Crew) -> None:
    crew.start("daemon", [*PYTHON, "import sys; print('armgate: port in use', file=sys.stderr); sys.exit(2)"])
    with pytest.raises(AppError, match=r"(?s)the daemon ended \(2\).*daemon\.log ends with.*port in use"):
        listening(crew)


def test_nobody_waits_for_a_daemon_when_asked_to_end(crew: Crew) -> None:
    crew.events.put(Asked(signal.SIGINT))
    with pytest.raises(AppError, match="interrupted before the daemon was ready"):
        listening(crew)


def test_a_run_is_done_when_both_controllers_have_ended(crew: Crew) -> None:
    pictures: list[int] = []
    crew.start("leader", GOOD)
    crew.start("follower", GOOD)
    assert course._until_done(crew, NAMES, lambda: pictures.append(1))
    assert pictures


def test_asked_to_end_it_is_not_complete_and_controllers_may_rest(crew: Crew) -> None:
    for name in ("daemon", "leader", "follower"):
        crew.start(name, POLITE)
        assert crew.next(30.0) == Printed(name, "ready")
    crew.events.put(Asked(signal.SIGINT))
    assert not course._until_done(crew, NAMES, lambda: None)
    course._rest(crew, plan())
    assert crew.running() == []
    assert crew.tail("leader")[-1] == "rested"
    assert crew.tail("daemon") == ["ready"]  # it was ended by SIGTERM, after the others


@pytest.mark.parametrize(
    ("code", "told"),
    [
        ("import sys; print('lost the lease', file=sys.stderr); sys.exit(1)", r"ended \(1\).*lost the lease"),
        ("import os, signal; os.kill(os.getpid(), signal.SIGKILL)", "was killed by SIGKILL"),
    ],
)
def test_a_controller_that_dies_ends_the_run_and_is_named(crew: Crew, code: str, told: str) -> None:
    crew.start("leader", POLITE)
    crew.start("follower", [*PYTHON, code])
    with pytest.raises(AppError, match=f"(?s)the follower {told}"):
        course._until_done(crew, NAMES, lambda: None)


def test_a_daemon_that_ends_by_itself_ends_the_run(crew: Crew) -> None:
    crew.start("leader", POLITE)
    crew.start("daemon", GOOD)
    with pytest.raises(AppError, match=r"the daemon ended \(0\)"):
        course._until_done(crew, NAMES, lambda: None)


def test_signals_become_an_event_and_the_second_one_ends_at_once(crew: Crew) -> None:
    before = signal.getsignal(signal.SIGTERM)
    with course.interruptions(crew):
        os.kill(os.getpid(), signal.SIGTERM)
        assert crew.next(30.0) == Asked(signal.SIGTERM)
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
    assert signal.getsignal(signal.SIGTERM) == before


def test_how_a_death_is_told(crew: Crew) -> None:
    crew.log("leader").write_text("one\ntwo\n")
    text = str(course.died(crew, Exited("leader", 1)))
    assert text.splitlines()[-2:] == ["  | one", "  | two"]


LINKS = Path(__file__).parents[2] / "configs" / "links" / "rsi-virtual.yaml"


def test_what_stands_in_for_real_robots_follows_from_their_links(tmp_path: Path) -> None:
    files = [LINKS.parents[1] / "demo.yaml", LINKS]
    robots = robots_of(load_config(files), files, tmp_path / "s", tmp_path)
    assert robots is not None
    assert robots.server(files) == ["robot-server", *map(str, files), "--socket", str(tmp_path / "s")]
    assert plan(robots=robots).daemon()[-2:] == ["--robot-server", str(tmp_path / "s")]
    assert list(robots.krcs) == ["krc-FR", "krc-GR"]
    words = list(robots.krcs["krc-GR"])
    options = dict(zip(words[1::2], words[2::2], strict=True))
    assert (options["--profile"], options["--robot"], options["--cycle"]) == ("krc2-rsi2", "GR", "12")
    assert (options["--axiscorr"], options["--axiscorrmon"]) == ("A=400,E=4000", "A=401,E=4001")
    assert Path(options["--config"]).name == "gantry-correction.xml"
    assert robots_of(load_config(files[:1]), files[:1], tmp_path / "s", tmp_path) is None


def test_a_real_robot_is_not_moved_by_a_demonstration(tmp_path: Path) -> None:
    real = tmp_path / "real.yaml"
    real.write_text("armgate: 1\nrobots: {GR: {link: {virtual: null}}}\n")
    files = [LINKS.parents[1] / "demo.yaml", LINKS, real]
    with pytest.raises(UsageError, match="GR has a real KRC"):
        robots_of(load_config(files), files, tmp_path / "s", tmp_path)
