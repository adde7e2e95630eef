"""Trials with commands: a daemon in lock-step, processes, and programs on connections of their own."""

import os
import select
import sys
import tempfile
from multiprocessing.util import get_temp_dir
from pathlib import Path

import pytest

from armgate.campaign.drive import Campaign, run_campaign
from armgate.campaign.laboratory import Laboratory
from armgate.campaign.local_pool import LocalPool
from armgate.campaign.result import Result
from support.campaigns import write_campaign

SCRIPT = """
import sys
import tempfile
import time
from armgate.client import connect
address, name, robot, length, seed = sys.argv[1:]
with connect(address, name=name) as cell, cell.acquire(robot) as held:
    for tick in held.ticks():
        held.send([float(length), 0.0, 0.0])
        if tick.time > 0.01 and length == "0.002":
            break
        if tick.time > 0.03 and length == "0.003":
            sys.exit("the script broke")
"""


def run(folder: Path, command: str | None, *, length: str = "0.001", recording: Path | None = None) -> Result:
    file = write_campaign(folder, seeds=1)
    if command is not None:
        (folder / "script.py").write_text(SCRIPT)
        file.write_text(file.read_text().replace('program: "odd:move"', command))
    campaign = Campaign.load(file)
    laboratory = Laboratory(campaign.config, campaign.basis)
    return laboratory.run(campaign.trials[0], recording)


def words(folder: Path, length: str) -> str:
    arguments = "'{address}', '{name}', '{robot}', '{length}', '{seed}'"
    return f"command: ['{sys.executable}', '{folder}/script.py', {arguments}], options: {{length: {length}}}"


@pytest.mark.slow
def test_a_command_has_the_figures_of_the_same_program(tmp_path: Path) -> None:
    program = run(tmp_path, None)
    command = run(tmp_path, words(tmp_path, "0.001"), recording=tmp_path / "recording")
    assert not program.failed
    assert not command.failed, command.reason
    assert command.figures.keys() == program.figures.keys()
    for name, value in program.figures.items():  # recordings round clearances down to 1 µm
        assert command.figures[name] == (pytest.approx(value, abs=1e-6) if "clearance" in name else value), (
            name
        )
    assert list((tmp_path / "recording").glob("*.mcap"))


@pytest.mark.slow
def test_the_end_of_a_command_ends_the_trial_and_a_failure_fails_it(tmp_path: Path) -> None:
    ends = run(tmp_path, words(tmp_path, "0.002"))
    assert not ends.failed, ends.reason
    assert 0.01 < ends.figures["duration"] < 0.05
    assert ends == run(tmp_path, words(tmp_path, "0.002"))
    broken = run(tmp_path, words(tmp_path, "0.003"))
    assert broken.reason == "CommandError: P ended with status 1: the script broke"


@pytest.mark.slow
def test_programs_and_commands_take_part_together(tmp_path: Path) -> None:
    zoom = "Z: {command: [armgate, zoom, '{address}', --name, '{name}', --rate, '0.1']}"
    file = write_campaign(tmp_path, seeds=1, more="until: [P]")
    file.write_text(
        file.read_text().replace('P: {program: "odd:move"}', f'P: {{program: "odd:move"}}, {zoom}')
    )
    campaign = Campaign.load(file)
    found = Laboratory(campaign.config, campaign.basis).run(campaign.trials[0])
    assert not found.failed, found.reason
    assert found.figures["P.commands"] == 5.0
    assert [name for name in found.figures if name.startswith("signal.") and "distance" in name]


ENDLESS = """
import os, sys, time
open(sys.argv[5], "w").write(str(os.getpid()))
if sys.argv[4] == "never":
    time.sleep(600)
from armgate.client import connect
address, name, robot = sys.argv[1:4]
with connect(address, name=name) as cell, cell.acquire(robot) as held:
    for tick in held.ticks():
        held.send([0.001, 0.0, 0.0])
"""


def wait_for_end(process: int) -> None:
    """Wait until a process has ended, which may be no child of this one."""
    try:
        descriptor = os.pidfd_open(process)
    except ProcessLookupError:
        return
    with os.fdopen(descriptor):
        select.select([descriptor], [], [])


@pytest.mark.parametrize(
    ("mode", "timeout", "failed"),
    [("steady", 15, False), pytest.param("never", 4, True, marks=pytest.mark.slow)],
)
def test_commands_end_with_the_trial_or_with_its_worker(
    tmp_path: Path, mode: str, timeout: int, failed: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    get_temp_dir()  # the fork server's folder stays where it is: the path of a Unix socket is short
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    (tmp_path / "temporary").mkdir()
    (tmp_path / "endless.py").write_text(ENDLESS)
    arguments = f"'{{address}}', '{{name}}', '{{robot}}', {mode}, '{tmp_path}/pid'"
    command = f"command: ['{sys.executable}', '{tmp_path}/endless.py', {arguments}]"
    file = write_campaign(tmp_path, seeds=1, more=f"timeout: {timeout} s\nattempts: 1")
    file.write_text(file.read_text().replace('program: "odd:move"', command))
    summary = run_campaign(Campaign.load(file), tmp_path / "out", lambda plan: LocalPool(plan, 1))
    assert summary.failed == failed, summary.reasons
    wait_for_end(int((tmp_path / "pid").read_text()))
    assert list((tmp_path / "temporary").glob("armgate-*")) == []
