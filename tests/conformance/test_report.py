"""Reports of a run: lines, exit status, JUnit, HTML page."""

import re
from xml.etree import ElementTree as ET

import pytest

from armgate.conformance import report
from armgate.conformance.case import Outcome, cases
from armgate.conformance.html_report import html_page
from armgate.conformance.runner import Result
from armgate.conformance.target import ServerInfo
from conformance.conftest import serving
from support.clients import run

SERVER = ServerInfo(
    {"versions": [1], "software": "<toy> 1"},
    {"name": "cell & co"},
    {"name": "R"},
)


def result(index, safety=Outcome.PASS, session=Outcome.PASS, findings=(), wire=()):
    return Result(cases()[index], safety, session, findings, 0.25, wire)


RESULTS = [
    result(0),
    result(1, session=Outcome.FAIL, findings=("session: got <b>\x00\ud800",), wire=("0.1 a → <x>",)),
    result(2, safety=Outcome.FAIL, findings=("safety: it moved",), wire=("0.2",)),
    result(40, session=Outcome.NON_STRICT, findings=("session: it should",), wire=("0.3",)),
    result(41, Outcome.SKIPPED, Outcome.SKIPPED, ("one robot only",)),
]


def test_the_worse_outcome_counts():
    assert [one.outcome.value for one in RESULTS] == ["PASS", "FAIL", "FAIL", "NON-STRICT", "SKIPPED"]


def test_the_last_line():
    assert report.last_line(RESULTS, strict=False) == "5 cases, 2 passed, 2 failed, 1 skipped"
    assert report.last_line(RESULTS, strict=True) == "5 cases, 1 passed, 3 failed, 1 skipped"


def test_a_failure_quotes_the_statement_and_shows_the_wire_log():
    text = report.failure(RESULTS[1])
    case = RESULTS[1].case
    assert case.statement.text in text
    assert case.expectation in text
    assert "0.1 a → <x>" in text


def test_junit_is_valid_xml(tmp_path):
    report.write_junit(RESULTS, tmp_path / "junit.xml", strict=False)
    root = ET.parse(tmp_path / "junit.xml").getroot()
    assert {key: root.get(key) for key in ("tests", "failures", "skipped")} == {
        "tests": "5", "failures": "2", "skipped": "1",
    }  # fmt: skip
    failure = next(root.iter("failure"))
    assert failure.get("message") == "safety PASS, session FAIL"
    assert "got <b>" in failure.text
    assert {suite.get("name") for suite in root} == {r.case.statement.section for r in RESULTS}


def test_the_page_is_self_contained_and_escapes_texts():
    text = html_page(RESULTS, SERVER, "h:1", False, "--only X")
    assert "&lt;toy&gt; 1" in text
    assert "cell &amp; co" in text
    assert "got &lt;b&gt;" in text
    assert not re.search(r"(src|href)=|@import|url\(|<script", text), "the page is not self-contained"
    assert text.count("<details") == len(RESULTS)
    assert text.count("<details open") == 3


def test_the_page_marks_up_code_in_statements():
    found = next(c for c in cases() if "`verdict`" in c.statement.text)
    text = html_page([Result(found, Outcome.PASS, Outcome.PASS)], SERVER, "h:1", False, "")
    assert "<code>verdict</code>" in text
    assert "`" not in text


def test_wire_logs_are_written(tmp_path):
    report.write_wire_logs(RESULTS, tmp_path)
    assert len(list(tmp_path.iterdir())) == 3


async def test_the_command_prints_results_and_exits_with_0(tmp_path):
    async with serving("conformance.yaml") as port:
        status, out, err = await run("conformance", f"127.0.0.1:{port}", "--only", "VER", "--out", tmp_path)
    assert (status, err) == (0, "")
    assert re.fullmatch(r"\d+ cases, \d+ passed, 0 failed, 0 skipped", out.splitlines()[-1])
    assert "<h1>" in (tmp_path / "report.html").read_text()


async def test_a_nonconforming_server_gives_status_1(monkeypatch):
    from armgate.world.welcome import Greeter

    right = Greeter.welcome
    monkeypatch.setattr(
        Greeter, "welcome", lambda self, *a: right(self, *a).model_copy(update={"client_versions": (7,)})
    )
    async with serving("conformance.yaml") as port:
        status, out, _ = await run("conformance", f"127.0.0.1:{port}", "--only", "VER-2/one")
    assert status == 1
    assert "VER-2: A server MUST choose" in out
    assert out.splitlines()[-1] == "1 cases, 0 passed, 1 failed, 0 skipped"


@pytest.mark.daily(2)
@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("127.0.0.1:1",), "no server of this protocol at 127.0.0.1:1"),
        (("localhost",), "is not an address"),
        ((), "give either HOST:PORT or --start COMMAND"),
        (("127.0.0.1:1", "--only", "FOO-1"), "no case FOO-1"),
        (("127.0.0.1:1", "--faults", "rain=1"), "--faults"),
        (("--start", "no-such-program-anywhere"), "--start"),
        (("--start", " "), "--start: the command is empty"),
        (("127.0.0.1:1", "--out", __file__), "wire: cannot be created (Not a directory)"),
        (("127.0.0.1:1", "--html", "."), ".: is a folder"),
        (("--start", "armgate serve no-such-cell.yaml"), "no-such-cell.yaml"),
        (("127.0.0.1:1", "--token-file", "no-such-file"), "--token-file no-such-file"),
        (("127.0.0.1:1", "--tls-ca", "no-such-file"), "no-such-file: No such file"),
        (("127.0.0.1:1", "--tls-ca", "x", "--tls-cert", "y"), "need each other"),
    ],
)
async def test_wrong_use_is_an_error_with_status_2(arguments, text):
    status, _, err = await run("conformance", *arguments)
    assert status == 2
    assert text in " ".join(err.split())
    assert "Traceback" not in err


async def test_a_run_without_applicable_cases_gives_status_2():
    async with serving("conformance.yaml") as port:
        status, out, _ = await run("conformance", f"127.0.0.1:{port}", "--only", "LCK-2")
    assert status == 2
    assert "only for a server in lock-step" in out


async def test_the_command_lists_the_cases():
    status, out, _ = await run("conformance", "--list")
    assert status == 0
    assert len(out.splitlines()) == len(cases())
