"""The monitor of a run: effects of its lines and of its end."""

import json
import signal
import sys

import pytest

from armgate.apps.errors import AppError
from armgate.apps.stack import monitoring
from armgate.apps.stack.processes import Children, Exited, Interrupted, Printed
from armgate.apps.stack.run import _goes_on

VIOLATED = "armgate: monitor: violated: FR, tick 7 (0.084 s): FR/link_3 and post are 48 mm apart"


@pytest.mark.parametrize(
    "text",
    ["armgate: monitor: watching FR: 45 bodies, 628 pairs", "armgate: monitor: 9 states, no violations", ""],
)
def test_other_lines_of_the_monitor_are_ignored(text):
    assert monitoring.violation_error(Printed(monitoring.MONITOR, text)) is None


def test_a_violation_ends_a_run_at_once_with_its_text(tmp_path):
    with Children(tmp_path) as children, pytest.raises(AppError, match="FR/link_3 and post are 48 mm apart"):
        _goes_on(children, Printed(monitoring.MONITOR, VIOLATED))


def test_a_run_fails_if_its_monitor_ends_first(tmp_path):
    with Children(tmp_path) as children:
        children.log(monitoring.MONITOR).write_text("no connection\n")
        with pytest.raises(AppError, match="the monitor ended"):
            _goes_on(children, Exited(monitoring.MONITOR, 0))


def test_a_line_of_another_child_is_not_a_violation():
    assert monitoring.violation_error(Printed("viewer", VIOLATED)) is None


def test_a_pending_violation_is_reported_instead_of_the_end_of_another_child(tmp_path):
    with Children(tmp_path) as children:
        children.log("follower").write_text("stopped\n")
        children.events.put(Printed(monitoring.MONITOR, VIOLATED))
        with pytest.raises(AppError, match="FR/link_3 and post are 48 mm apart"):
            _goes_on(children, Exited("follower", 1))


def audited(folder, code: str, monkeypatch, *events):
    """Return the result of an audit by a child that runs this code."""
    with Children(folder) as children:
        monkeypatch.setattr(
            children,
            "launch",
            lambda name, arguments, priority: children.start(name, [sys.executable, "-c", code]),
        )
        for event in events:
            children.events.put(event)
        return monitoring.audit(children, folder)


@pytest.mark.parametrize(
    ("code", "text"),
    [
        ("print('armgate: monitor: 9 states, no violations')", None),
        (f"print({VIOLATED!r}); raise SystemExit(1)", "FR/link_3 and post are 48 mm apart"),
        ("raise SystemExit('the recording breaks off')", r"ended \(1\): the recording breaks off"),
    ],
)
def test_a_run_fails_if_its_audit_finds_a_violation_or_fails(tmp_path, monkeypatch, code, text):
    done, error = audited(tmp_path, code, monkeypatch)
    assert done
    if text is None:
        assert error is None
    else:
        with pytest.raises(AppError, match=text):
            raise error


def test_an_interrupted_audit_ends(tmp_path, monkeypatch):
    (tmp_path / "monitor.json").write_text('{"states":')  # incomplete
    code = "import time; time.sleep(600)"
    assert audited(tmp_path, code, monkeypatch, Interrupted(signal.SIGINT)) == (False, None)
    assert monitoring.read_report(tmp_path) is None


@pytest.mark.slow
def test_output_does_not_extend_the_timeout_of_an_audit(tmp_path, monkeypatch):
    monkeypatch.setattr(monitoring, "AUDIT_TIME", 1.0)
    code = "import time\nfor _ in range(300): print('on', flush=True); time.sleep(0.1)"
    _, error = audited(tmp_path, code, monkeypatch)
    assert "took longer than 1 s" in str(error)


def test_the_report_is_read_from_the_monitors_file(tmp_path):
    assert monitoring.read_report(None) is None
    assert monitoring.read_report(tmp_path) is None
    (tmp_path / "monitor.json").write_text(json.dumps({"states": 7}))
    assert monitoring.read_report(tmp_path) == {"states": 7}
    assert "--json" in monitoring.monitor_command("127.0.0.1:1", [], tmp_path)
    assert "--json" not in monitoring.monitor_command("127.0.0.1:1", [], None)
