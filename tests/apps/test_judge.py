"""The monitor of a run: what its lines and its end mean for the run."""

import json
import signal
import sys

import pytest

from armgate.apps.errors import AppError
from armgate.apps.stack import judge
from armgate.apps.stack.processes import Asked, Crew, Exited, Printed
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


def test_the_line_of_another_child_is_no_finding():
    assert judge.finding(Printed("viewer", VIOLATED)) is None


def test_a_broken_rule_is_the_cause_of_an_end_that_comes_before_it(tmp_path):
    with Crew(tmp_path) as crew:
        crew.log("follower").write_text("stopped\n")
        crew.events.put(Printed(judge.MONITOR, VIOLATED))
        with pytest.raises(AppError, match="FR/link_3 and post are 48 mm apart"):
            _goes_on(crew, Exited("follower", 1))


def audited(folder, code: str, monkeypatch, *events):
    """Return the result of an audit by a child that runs this code."""
    with Crew(folder) as crew:
        monkeypatch.setattr(
            crew, "launch", lambda name, arguments, priority: crew.start(name, [sys.executable, "-c", code])
        )
        for event in events:
            crew.events.put(event)
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
    done, error = audited(tmp_path, code, monkeypatch)
    assert done
    if said is None:
        assert error is None
    else:
        with pytest.raises(AppError, match=said):
            raise error


def test_an_audit_ends_when_the_user_asks_for_it(tmp_path, monkeypatch):
    (tmp_path / "monitor.json").write_text('{"states":')  # not whole
    code = "import time; time.sleep(600)"
    assert audited(tmp_path, code, monkeypatch, Asked(signal.SIGINT)) == (False, None)
    assert judge.account(tmp_path) is None


def test_an_audit_has_one_limit_of_time_however_much_it_prints(tmp_path, monkeypatch):
    monkeypatch.setattr(judge, "AUDIT_TIME", 1.0)
    code = "import time\nfor _ in range(300): print('on', flush=True); time.sleep(0.1)"
    _, error = audited(tmp_path, code, monkeypatch)
    assert "took longer than 1 s" in str(error)


def test_the_account_is_what_the_monitor_wrote(tmp_path):
    assert judge.account(None) is None
    assert judge.account(tmp_path) is None
    (tmp_path / "monitor.json").write_text(json.dumps({"states": 7}))
    assert judge.account(tmp_path) == {"states": 7}
    assert "--json" in judge.watching("127.0.0.1:1", [], tmp_path)
    assert "--json" not in judge.watching("127.0.0.1:1", [], None)
