"""A trial in a world has the figures of the same trial over sockets, byte for byte."""

import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from armgate.apps.default_files import default_file
from armgate.apps.errors import AppError, UsageError
from armgate.apps.stack.fork_server import ForkServer
from armgate.experiment import world_trial
from armgate.experiment.lab import PlannedTrial, TrialLab, flat, plan_trials, repeat
from armgate.experiment.paths import joystick
from armgate.experiment.scene import Scene, build_scene, off_axis_start
from armgate.experiment.trial_run import play
from armgate.experiment.trials import BodyPursuit, DistanceRange, Trial
from armgate.experiment.world_trial import play_in_world

FOCUS = (2.0, 0.0, 1.0)
IGNORED = ("monitor", "realtime_factor")
"""Figures that only a run of processes has."""


@pytest.fixture(scope="module")
def scene() -> Scene:
    return build_scene((default_file("demo.yaml"),))


@pytest.fixture(scope="module")
def fork_server() -> ForkServer:
    server = ForkServer()
    server.warm()
    return server


def tour(scene: Scene, seed: int, speed: float, seconds: float = 3.0) -> np.ndarray:
    half = np.array([0.3, 0.7, 0.35])
    return joystick(seed, speed, np.array(FOCUS), half, seconds=seconds, period=scene.leader.period)


def trials(scene: Scene) -> list[Trial]:
    near = tour(scene, 3, 0.2, 5.0)
    pursuit = BodyPursuit("link_3", 0.5)
    return [
        Trial("fast-predicted", 1, 0.0, 1.0, path=tour(scene, 1, 0.5)),
        Trial("approach", 2, 0.0, 1.0, start=off_axis_start(scene, 2), seconds=2.0),
        Trial("zoom", 3, 0.03, 1.0, path=near, zoom=DistanceRange(0.5, 1.3, 0.1)),
        Trial("dash-0.5", 4, 0.03, 1.0, focus=FOCUS, path=tour(scene, 4, 0.5), seconds=3.0),
        Trial("pursuit-0.5", 5, 0.03, 1.0, focus=FOCUS, path=near[:1], pursuit=pursuit, seconds=3.0),
        *(
            Trial("slow", seed, 0.12, 1.0, path=tour(scene, seed, 0.25), predict=False)
            for seed in range(6, 11)
        ),
    ]


def test_a_recorded_trial_is_audited_and_has_the_same_figures_again(scene: Scene, tmp_path: Path) -> None:
    trial = Trial("approach", 2, 0.0, 1.0, start=off_axis_start(scene, 2), seconds=0.5)
    entry = play_in_world(trial, scene, tmp_path / "a", record=True)
    assert entry["monitor"]["violations"] == 0
    assert entry["monitor"]["missed"] == {}
    play_in_world(trial, scene, tmp_path / "b", record=True)
    for name in ("series.csv", "metrics.json", "monitor.json"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_a_violation_that_the_monitor_reports_fails_the_trial(
    scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def violated(arguments: list[str]) -> None:
        sys.stdout.write("armgate: monitor: violated: too near\n")
        raise SystemExit(1)

    monkeypatch.setattr(world_trial, "main", violated)
    trial = Trial("approach", 2, 0.0, 1.0, start=off_axis_start(scene, 2), seconds=0.5)
    planned = PlannedTrial("k", "approach", "approach", 2, (), trial, tmp_path / "a")
    result = TrialLab(scene).run(planned)
    assert result.failed
    assert "the monitor ended (1): armgate: monitor: violated: too near" in result.reason
    assert not planned.done


def test_a_repeated_trial_is_compared_with_its_run(scene: Scene, tmp_path: Path) -> None:
    run = Trial("approach", 2, 0.0, 1.0, start=off_axis_start(scene, 2), seconds=0.5)
    planned = plan_trials("approach", [run], tmp_path)
    assert "there is no run" in list(repeat(planned, "approach-2", scene, tmp_path))[-1]
    assert not TrialLab(scene).run(planned[0]).failed
    assert "byte for byte" in list(repeat(planned, "approach-2", scene, tmp_path))[-1]
    with (planned[0].folder / "series.csv").open("a") as file:
        file.write("0\n")
    with pytest.raises(AppError, match=r"series\.csv: differs from"):
        list(repeat(planned, "approach-2", scene, tmp_path))
    with pytest.raises(UsageError, match=r"--trial fast-9: there is no such trial; .* approach-2"):
        list(repeat(planned, "fast-9", scene, tmp_path))


def test_keys_depend_on_everything_that_determines_a_trial(scene: Scene, tmp_path: Path) -> None:
    path = tour(scene, 1, 0.5)
    base = Trial("zoom", 3, 0.03, 1.0, path=path, zoom=DistanceRange(0.5, 1.3, 0.1))
    others = [
        replace(base, seed=4), replace(base, lag=0.0), replace(base, distance=1.1),
        replace(base, predict=False), replace(base, focus=FOCUS), replace(base, path=path + 1e-9),
        replace(base, start=np.zeros(6)),
        replace(base, zoom=DistanceRange(0.5, 1.3, 0.2)), replace(base, pursuit=BodyPursuit("link_3", 0.5)),
        replace(base, seconds=2.0),
    ]  # fmt: skip
    planned = plan_trials("zoom", [base, *others], tmp_path) + plan_trials("other", [base], tmp_path)
    assert len({trial.key for trial in planned}) == len(planned)
    assert plan_trials("zoom", [base], tmp_path)[0].key == planned[0].key


def test_numbers_of_nested_figures_are_stored_flat() -> None:
    entry = {"a": {"max": 1.5, "rms": None}, "complete": True, "pair": ["x", "y"], "n": 3, "text": "t"}
    assert dict(flat(entry)) == {"a.max": 1.5, "complete": 1.0, "n": 3.0}


def figures(folder: Path) -> dict[str, Any]:
    found = json.loads((folder / "metrics.json").read_text())
    return {name: value for name, value in found.items() if name not in IGNORED}


@pytest.mark.daily(1)
@pytest.mark.parametrize("number", range(10))
def test_a_trial_in_a_world_has_the_figures_of_its_processes(
    scene: Scene, fork_server: ForkServer, tmp_path: Path, number: int
) -> None:
    trial = trials(scene)[number]
    played = play(trial, scene, tmp_path / "sockets", fork_server, realtime=False, show=lambda _watch: None)
    assert played is not None
    play_in_world(trial, scene, tmp_path / "world")
    series = [(tmp_path / way / "series.csv").read_bytes() for way in ("sockets", "world")]
    assert series[0].count(b"\n") > 150
    assert series[0] == series[1]
    assert figures(tmp_path / "sockets") == figures(tmp_path / "world")


def test_a_run_whose_files_are_torn_is_not_done(tmp_path: Path) -> None:
    run = Trial("approach", 0, 0.0, 1.0)
    planned = PlannedTrial("k", "approach", "approach", 0, (), run, tmp_path)
    assert not planned.done
    (tmp_path / "series.csv").write_text("time\n")
    for text, done in [("", False), ('{"case": ', False), ("\0" * 9, False), ("{}", True)]:
        (tmp_path / "metrics.json").write_text(text)
        assert planned.done == done
    (tmp_path / "series.csv").unlink()
    assert not planned.done
