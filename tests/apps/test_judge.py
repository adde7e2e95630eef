"""The monitor of a run: what its lines and its end mean for the run."""

import json
import sys

import pytest

from armgate.apps.errors import AppError
from armgate.apps.stack import judge
from armgate.apps.stack.processes import Crew, Exited, Printed
from armgate.apps.stack.run import _goes_on

VIOLATED = "armgate: monitor: violated: FR, tick 7 (0.084 s): FR/link_3 and post are 48 mm apart"


@pytest.mark.parametrize(
    "text",
    ["armgate: monitor: watching FR: 45 bodies, 628 pairs", "armgate: monitor: 9 states, no violations", ""],
)
def test_other_lines_mean_nothing(text):
    assert judge.finding(Printed(judge.MONITOR, text)) is None


def test_a_violation_ends_a_run_at_once_with_its_text(tmp_path):
    with Crew(tmp_path) as crew, pytest.raises(AppError, match="FR/link_3 and post are 48 mm apart"):
        _goes_on(crew, Printed(judge.MONITOR, VIOLATED))


def test_a_monitor_that_ends_before_the_run_does_fails_it(tmp_path):
    with Crew(tmp_path) as crew:
        crew.log(judge.MONITOR).write_text("no connection\n")
        with pytest.raises(AppError, match="the monitor ended"):
            _goes_on(crew, Exited(judge.MONITOR, 0))


def audited(folder, code: str, monkeypatch):
    """What the audit by a child means that runs this code."""
    with Crew(folder) as crew:
        monkeypatch.setattr(
            crew, "launch", lambda name, arguments, priority: crew.start(name, [sys.executable, "-c", code])
        )
        return judge.audit(crew, folder)


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("print('armgate: monitor: 9 states, no violations')", None),
        (f"print({VIOLATED!r}); raise SystemExit(1)", "FR/link_3 and post are 48 mm apart"),
        ("raise SystemExit('the recording breaks off')", r"ended \(1\): the recording breaks off"),
    ],
)
def test_an_audit_fails_a_run_if_it_finds_something_or_fails_itself(tmp_path, monkeypatch, code, said):
    error = audited(tmp_path, code, monkeypatch)
    if said is None:
        assert error is None
    else:
        with pytest.raises(AppError, match=said):
            raise error


def test_the_account_is_what_the_monitor_wrote(tmp_path):
    assert judge.account(None) is None
    assert judge.account(tmp_path) is None
    (tmp_path / "monitor.json").write_text(json.dumps({"states": 7}))
    assert judge.account(tmp_path) == {"states": 7}
    assert "--json" in judge.watching("127.0.0.1:1", [], tmp_path)
    assert "--json" not in judge.watching("127.0.0.1:1", [], None)
