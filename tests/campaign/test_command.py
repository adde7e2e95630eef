"""``armgate campaign`` on the command line: exit statuses, errors without traceback, options."""

import sys
from pathlib import Path

import pytest

from armgate.apps.cli import main
from support.campaigns import write_campaign


def call(capsys: pytest.CaptureFixture[str], *words: object) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as ended:
        main(["campaign", *map(str, words)])
    said = capsys.readouterr()
    return int(ended.value.code or 0), said.out, said.err


def test_claims_decide_the_exit_status(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    claim = "claims: [{{claim: few, figure: commands, aggregate: max, at_most: {}}}]"
    file, out = write_campaign(tmp_path, seeds=1, more=claim.format(9)), tmp_path / "out"
    status, text, _ = call(capsys, file, "--out", out, "--jobs", 1)
    assert status == 0
    assert "1/1" in text
    assert "few" in text
    assert "holds" in text
    write_campaign(tmp_path, seeds=1, more=claim.format(2))
    status, text, _ = call(capsys, file, "--out", out, "--jobs", 1)
    assert status == 1
    assert "does not hold" in text
    write_campaign(tmp_path, seeds=2, more=claim.format(2))
    status, _, errors = call(capsys, file, "--out", out)
    assert status == 2
    assert "campaign.seeds: 1 before, 2 now" in errors


def test_failed_trials_are_a_failure_and_their_reasons_are_printed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = write_campaign(tmp_path, seeds=2, programs=("bad", "move"))
    status, text, _ = call(capsys, file, "--out", tmp_path / "out", "--jobs", 1)
    assert status == 1
    assert "2 failed: ZeroDivisionError: division by zero\n" in text
    claim = "claims: [{claim: half may fail, figure: failed, aggregate: share, at_most: 0.5}]"
    file = write_campaign(tmp_path, seeds=2, programs=("bad", "move"), more=claim)
    status, text, _ = call(capsys, file, "--out", tmp_path / "out", "--jobs", 1)
    assert status == 0
    assert "2 failed: ZeroDivisionError: division by zero\n" in text


def test_a_missing_extra_is_reported_before_the_first_trial(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in [name for name in sys.modules if name.partition(".")[0] == "arro3"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "arro3", None)
    status, text, errors = call(capsys, write_campaign(tmp_path), "--out", tmp_path / "out", "--jobs", 1)
    assert (status, text) == (1, "")
    assert (
        errors
        == "armgate: arro3.io is not installed; run in a checkout of armgate: pip install '.[campaign]'\n"
    )


@pytest.mark.parametrize(
    ("words", "status", "error"),
    [
        (["no.yaml"], 2, "no.yaml: "),
        (["FILE", "--jobs", 1, "--dask", 1], 2, "at most one of --jobs, --scheduler, --dask and --trial"),
        (["FILE", "--trial", "zz"], 2, "--trial zz: no trials have this key"),
        (["FILE", "--jobs", 0], 2, "--jobs"),
        (
            ["FILE", "--out", "OUT", "--scheduler", "nix"],
            2,
            "--scheduler nix: expected an address such as tcp:",
        ),
        (
            ["FILE", "--out", "FILE"],
            1,
            "small.yaml: cannot be written: Not a directory; 0 results are stored",
        ),
    ],
)
def test_wrong_use_is_one_clear_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[object], status: int, error: str
) -> None:
    file = write_campaign(tmp_path, seeds=1)
    found, _, errors = call(
        capsys, *[{"FILE": file, "OUT": tmp_path / "out"}.get(word, word) for word in words]
    )
    assert found == status
    assert error in " ".join(errors.replace("│", " ").split())
    assert "Traceback" not in errors
