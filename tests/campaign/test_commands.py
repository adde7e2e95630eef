"""Trials with commands: a daemon in lock-step, processes, and programs on connections of their own."""

import sys
from pathlib import Path

import pytest

from armgate.campaign.drive import Campaign
from armgate.campaign.laboratory import Laboratory
from armgate.campaign.result import Result
from support.campaigns import write_campaign

SCRIPT = """
import sys
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
