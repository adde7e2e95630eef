"""The command line's root: help, version, exit statuses, errors in one line."""

import math
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import typer

from armgate.apps import cli
from armgate.apps.cli import as_command, commands
from armgate.apps.default_files import default_file
from armgate.apps.errors import AppError, UsageError
from armgate.cell.errors import ConfigError
from armgate.client import BadArgument, ConnectionLost


class Entry:
    """Entry point without an installation."""

    def __init__(self, function: Callable[..., None]) -> None:
        self.load = lambda: function


def called(
    monkeypatch: pytest.MonkeyPatch, function: Callable[..., None], *arguments: str
) -> int | str | None:
    monkeypatch.setattr(cli, "commands", lambda: {"do": Entry(function)})
    with pytest.raises(SystemExit) as ended:
        cli.main(["do", *arguments])
    return ended.value.code


def failing(error: BaseException) -> Callable[[], None]:
    def do() -> None:
        """Do it."""
        raise error

    return do


@pytest.mark.parametrize(
    ("error", "status", "text"),
    [
        (AppError("the arm is stuck"), 1, "armgate: the arm is stuck\n"),
        (UsageError("no such robot"), 2, "armgate: no such robot\n"),
        (ConfigError("demo.yaml:3: name: missing"), 2, "armgate: demo.yaml:3: name: missing\n"),
        (ConnectionLost("connection refused"), 1, "armgate: connection refused\n"),
        (ConnectionLost("fire\x1b[2J\nout"), 1, "armgate: fire\\x1b[2J\\nout\n"),
        (AppError("\x1b]0;x\x07\nlast lines"), 1, "armgate: \\x1b]0;x\\x07\nlast lines\n"),
        (BadArgument("address 'x': no port"), 2, "armgate: address 'x': no port\n"),
        (FileNotFoundError(2, "No such file or directory", "a.yaml"), 1, "armgate: a.yaml: No such file"),
        (
            ModuleNotFoundError("x", name="pinocchio"),
            1,
            "run in a checkout of armgate: pip install '.[cell]'",
        ),
        (
            ModuleNotFoundError("x", name="matplotlib.pyplot"),
            1,
            "run in a checkout of armgate: pip install '.[plots]'",
        ),
        (KeyboardInterrupt(), 130, ""),
    ],
)
def test_errors_are_one_line_and_a_status(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    error: Exception,
    status: int,
    text: str,
) -> None:
    assert called(monkeypatch, failing(error)) == status
    printed = capsys.readouterr().err
    assert text in printed
    assert "Traceback" not in printed


def test_a_defect_keeps_its_traceback(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cli, "commands", lambda: {"do": Entry(failing(ZeroDivisionError()))})
    with pytest.raises(ZeroDivisionError):
        cli.main(["do"])


def test_success_and_wrong_use(monkeypatch: pytest.MonkeyPatch) -> None:
    def do(number: int) -> None:
        """Do it."""

    assert called(monkeypatch, do, "3") == 0
    assert called(monkeypatch, do, "three") == 2
    assert called(monkeypatch, do) == 2
    assert called(monkeypatch, do, "3", "--unknown") == 2


def test_an_unknown_command_and_no_command(capsys: pytest.CaptureFixture[str]) -> None:
    for arguments in (["fly"], []):
        with pytest.raises(SystemExit) as ended:
            cli.main(arguments)
        assert ended.value.code == 2
    assert "No such command 'fly'" in capsys.readouterr().err


def armgate(*arguments: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [sys.executable, "-m", "armgate.apps", *arguments], capture_output=True, text=True, check=False
    )


def test_help_lists_every_command_and_imports_nothing_heavy() -> None:
    code = (
        "import sys\nfrom armgate.apps.cli import main\n"
        "try:\n    main(['--help'])\n"
        "finally:\n"
        "    heavy = {'pinocchio', 'coal', 'matplotlib', 'numpy', 'armgate.client'} & set(sys.modules)\n"
        "    print('heavy:', sorted(heavy))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    for command in ("serve", "demo", "lead", "follow", "check", "rsi"):
        assert f" {command} " in done.stdout
    assert "heavy: []" in done.stdout


def test_version() -> None:
    done = armgate("--version")
    assert done.returncode == 0
    assert done.stdout.startswith("armgate ")


PAIR = ("--robot", "FR", "--leader", "GR")


@pytest.mark.daily(1)
@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("lead", "nowhere", "--path", "PATH"), "address 'nowhere': no port"),
        (("lead", "127.0.0.1:9", "--path", "none.csv"), "none.csv: cannot be read"),
        (("lead", "127.0.0.1:9", "--path", "PATH", "--duration", "-1"), "--duration"),
        (("lead", "127.0.0.1:9"), "exactly one of --path FILE, --input NAME and --pursue ROBOT/BODY"),
        (("lead", "127.0.0.1:9", "--path", "PATH", "--pursue", "FR/link_3"), "exactly one of --path"),
        (("follow", "127.0.0.1:9"), "--robot"),
        (("follow", "nowhere", *PAIR), "address 'nowhere': no port"),
        (("follow", "127.0.0.1:9", *PAIR, "--focus", "nan", "0", "1"), "--focus"),
        (("follow", "127.0.0.1:9", *PAIR, "--distance", "inf"), "--distance"),
        (("follow", "127.0.0.1:9", *PAIR, "--lag", "inf"), "--lag"),
        (
            ("reach", "127.0.0.1:9", "--robot", "P", "--target", *"110", "--out", "none/p.csv"),
            "no folder none",
        ),
        (("reach", "127.0.0.1:9", "--robot", "P", "--target", *"110", "--out", "."), ".: is a folder"),
        (("demo", "none.yaml"), "none.yaml"),
        (("demo", "--path", "none.csv"), "none.csv: cannot be read"),
        (("demo", "--links", "none.yaml"), "none.yaml"),
        (("demo", "PLANAR"), "was recorded with GR; cell 'planar'"),
        (("demo", "--out", "FILE"), "cannot be created"),
    ],
)
def test_wrong_usage_is_status_2_with_a_reason(tmp_path: Path, arguments: tuple[str, ...], text: str) -> None:
    (tmp_path / "file").write_text("")
    places = {
        "PATH": str(default_file("paths/inspection.csv")),
        "PLANAR": str(default_file("planar.yaml")),
        "FILE": str(tmp_path / "file"),
    }
    done = armgate(*(places.get(word, word) for word in arguments))
    assert (done.returncode, "Traceback" in done.stderr) == (2, False), done.stderr
    assert text in done.stderr


@pytest.mark.daily(2)
@pytest.mark.parametrize(
    "options",
    [
        ("--target", "nan", "0", "0"),
        ("--target", "0", "-inf", "0"),
        ("--target", "0", "0", "1e7"),
        ("--rpy", "nan", "0", "0"),
        ("--duration", "inf"),
        ("--speed", "nan"),
    ],
)
def test_bad_numbers_are_refused_before_connecting(options: tuple[str, ...]) -> None:
    done = armgate("reach", "127.0.0.1:9", "--robot", "FR", *options)
    assert done.returncode == 2
    assert options[0] in done.stderr
    assert "no connection" not in done.stderr


def every_parameter() -> Iterator[tuple[str, Any]]:
    """Yield all options and arguments of all registered commands."""
    waiting = [as_command(name, entry.load()) for name, entry in commands().items()]
    for command in waiting:
        waiting += getattr(command, "commands", {}).values()
        yield from ((f"{command.name} {parameter.name}", parameter) for parameter in command.params)


def test_no_option_accepts_a_non_finite_or_huge_number() -> None:
    found = dict(every_parameter())
    assert len(found) > 100
    for parameter in found.values():
        for value in (math.nan, math.inf, -math.inf, -1e300, (0.0, math.nan, 0.0), [math.inf]):
            with pytest.raises(typer.BadParameter, match="expected a finite number within ±1,000,000"):
                parameter.callback(None, parameter, value)


@pytest.mark.slow
def test_a_refused_connection_is_status_1() -> None:
    done = armgate("follow", "127.0.0.1:9", "--robot", "FR", "--leader", "GR")
    assert done.returncode == 1
    assert done.stderr.startswith("armgate: no connection to 127.0.0.1:9")
    assert done.stderr.count("\n") == 1


def test_configurations_are_found_from_anywhere(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    assert default_file("demo.yaml").is_file()
    with pytest.raises(UsageError, match=r"nope\.yaml: not found"):
        default_file("nope.yaml")
