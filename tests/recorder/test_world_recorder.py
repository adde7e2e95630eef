"""Recordings of a world: complete, and replayed bit for bit."""

import random

import pytest

from armgate.audit.recorded_cell import recorded_cell
from armgate.audit.replay import replay_recording
from armgate.protocol import messages as m
from armgate.recorder import WorldRecorder
from armgate.recording import CellState, Recording
from armgate.world import World
from support.cells import arms_yaml
from support.sessions import RandomSessions


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "arms.yaml"
    path.write_text(arms_yaml(periods=(0.012, 0.004), lag=0.03))
    return path


@pytest.mark.parametrize("compiled", [False, None])
def test_a_recorded_world_replays_bit_for_bit(tmp_path, file, compiled):
    with WorldRecorder(tmp_path / "run") as recorder:
        world = World.load(file, participants=["a", "b"], recorders=[recorder], compiled=compiled)
        RandomSessions(world, random.Random(3)).run(600)
    recording = Recording.open(tmp_path / "run")
    result = replay_recording(recording, recorded_cell(recording.header))
    assert (result.count, result.differs_in) == (0, [])
    assert result.verdicts > 50
    steps = [item.step for _, item in recording.items() if isinstance(item, CellState)]
    assert steps == list(range(world.number + 1))


def test_a_recording_of_several_parts_is_complete(tmp_path, file):
    with WorldRecorder(tmp_path / "run", rotate=1) as recorder:
        world = World.load(file, participants=["a"], recorders=[recorder])
        world.join("a").send(m.Subscribe())
        for _ in range(3000):
            world.step()
    recording = Recording.open(tmp_path / "run")
    assert len(recording.parts) > 1
    assert replay_recording(recording, recorded_cell(recording.header)).count == 0


def test_a_fork_does_not_write_to_the_recording(tmp_path, file):
    with WorldRecorder(tmp_path / "run") as recorder:
        world = World.load(file, participants=["a"], recorders=[recorder])
        fork = world.fork()
        fork.step()
        world.step()
    steps = [x.step for _, x in Recording.open(tmp_path / "run").items() if isinstance(x, CellState)]
    assert steps == [0, 1]


def test_a_folder_that_cannot_be_written_is_an_error_at_once(tmp_path, file):
    (tmp_path / "run").write_text("a file")
    with pytest.raises(OSError, match="run"):
        World.load(file, participants=["a"], recorders=[WorldRecorder(tmp_path / "run")])


def test_a_step_after_the_end_of_the_recording_is_an_error(tmp_path, file):
    with WorldRecorder(tmp_path / "run") as recorder:
        world = World.load(file, participants=["a"], recorders=[recorder])
        world.step()
    with pytest.raises(ValueError, match="the recording is closed"):
        world.step()
