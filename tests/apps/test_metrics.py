"""Figures from synthetic states, computed by hand."""

import json
import math
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
import pytest

from armgate.apps.errors import UsageError
from armgate.apps.stack.metrics import columns, compute, transient_end, verdict_table
from armgate.apps.stack.observation import COLUMNS, Observation, same_robot
from armgate.apps.stack.run_folder import make_folder, write_metrics, write_series
from armgate.client import State

Make = Callable[..., State]
T = 0.012


def observation_of(states: Iterable[State]) -> Observation:
    seen = Observation("FR")
    for state in states:
        seen.take(state)
    return seen


def approach(make: Make, ticks: int = 400) -> Observation:
    """Return an observation: 10° and 50 mm before tick 50, then 0.5° and −3 mm, which is in the band."""
    return observation_of(
        make(k, angle=10.0 if k < 50 else 0.5, distance=0.05 if k < 50 else -0.003, progress=k / ticks)
        for k in range(ticks)
    )


def test_the_transient_is_over_after_one_second_in_the_band() -> None:
    time = np.arange(1000) * 0.01
    angle = np.radians(np.where(time < 0.4, 5.0, 0.2))
    assert transient_end(time, angle) == pytest.approx(0.39 + 1.0)


def test_leaving_the_band_restarts_the_second_and_five_seconds_end_the_transient() -> None:
    time = np.arange(1000) * 0.01
    restless = np.radians(np.where((time * 2).astype(int) % 2 == 0, 5.0, 0.2))
    assert transient_end(time, restless) == pytest.approx(5.0)


def test_time_counts_from_the_followers_first_value_and_without_one_the_transient_never_ends() -> None:
    time = np.arange(1000) * 0.01
    angle = np.where(time < 2.0, np.nan, 0.0)
    assert transient_end(time, angle) == pytest.approx(3.0)
    assert transient_end(time, np.full(1000, np.nan)) == math.inf
    assert transient_end(time[:50], np.zeros(50)) == math.inf


def test_figures_cover_the_time_after_the_transient(make_state: Make) -> None:
    metrics = compute(approach(make_state), 0.05, wall=2.4, complete=True)
    assert metrics["transient_s"] == pytest.approx(49 * T + 1.0, abs=T)
    assert metrics["angle_error_deg"] == pytest.approx({"max": 0.5, "rms": 0.5})
    assert metrics["distance_error_m"] == pytest.approx({"max": 0.003, "rms": 0.003})
    assert metrics["realtime_factor"] == pytest.approx(399 * T / 2.4)
    assert metrics["ticks"] == {"FR": 399, "GR": 399}
    assert metrics["nearest_pair"] == ["FR/link_5", "GR/link_6"]
    assert metrics["min_clearance_m"] == 0.3  # the daemon's value, although no state showed less than 0.4
    assert metrics["holds"] == {"angle": True, "distance": True, "clearance": True, "in_time": True}


def test_a_violated_claim_is_reported(make_state: Make) -> None:
    states = [make_state(k, angle=0.1) for k in range(200)]
    states.append(make_state(200, angle=1.2, distance=-0.021, least=0.049, late=2))
    metrics = compute(observation_of(states), 0.05, 1.0, True)
    assert metrics["holds"] == {"angle": False, "distance": False, "clearance": False, "in_time": False}
    assert metrics["late_commands"] == 4  # of both robots


def test_a_run_too_short_to_decide(make_state: Make, tmp_path: Path) -> None:
    metrics = compute(observation_of([make_state(0, angle=None)]), 0.05, 0.0, False)
    assert metrics["angle_error_deg"] == {"max": None, "rms": None}
    assert metrics["holds"]["angle"] is None
    assert metrics["realtime_factor"] is None
    write_metrics(tmp_path, metrics)
    assert json.loads((tmp_path / "metrics.json").read_text())["transient_s"] is None
    nothing = compute(Observation("FR"), 0.05, 0.0, False)
    assert nothing["holds"]["clearance"] is None


def test_verdicts_by_outcome_and_reason() -> None:
    counts = {"admitted": 7, "limited:acceleration": 2, "limited:clearance": 1, "refused:stale": 3}
    assert verdict_table(counts) == {
        "admitted": 7, "limited": {"acceleration": 2, "clearance": 1}, "refused": {"stale": 3},
    }  # fmt: skip


def test_missed_states_are_counted_and_warnings_kept_once(make_state: Make) -> None:
    states = [
        make_state(1),
        make_state(2, warnings=("gap", "1 late")),
        make_state(6, warnings=("2 late", "gap")),
    ]
    seen = observation_of(states)
    assert seen.missed == {"FR": 3}
    assert seen.warnings == ["gap", "2 late"]
    assert len(seen.rows) == 3


def test_states_of_other_robots_add_no_rows(make_state: Make) -> None:
    assert observation_of([make_state(1, robot="GR"), make_state(1)]).rows[0][0] == 0.0
    assert len(observation_of([make_state(1, robot="GR"), make_state(1)]).rows) == 1


def test_distances_within_one_robot_do_not_count_as_clearance(make_state: Make) -> None:
    near = (("FR/link_1", "FR/link_4", 0.01, 0.02), ("GR/link_6", "floor", 0.2, 0.05))
    seen = observation_of([make_state(1, near=near)])
    assert seen.nearest == (0.2, ("GR/link_6", "floor"))
    assert same_robot(("FR/a", "FR/b"))
    assert not same_robot(("FR/a", "floor"))
    assert not same_robot(("floor", "floor"))


def test_the_picture_keeps_a_signal_without_an_owner_and_the_series_does_not(make_state: Make) -> None:
    seen = observation_of([make_state(1, angle=2.0), make_state(2, angle=None)])
    assert seen.scalar("follow.angle_error") == pytest.approx(math.radians(2.0))
    assert math.isnan(columns(seen.rows)["angle_error_rad"][-1])


def test_the_series_file_has_all_columns(make_state: Make, tmp_path: Path) -> None:
    write_series(tmp_path, approach(make_state, 5).rows)
    lines = (tmp_path / "series.csv").read_text().splitlines()
    assert lines[0].split(",") == list(COLUMNS)
    assert len(lines) == 6
    assert lines[2].startswith("0.012,")


def test_the_run_folder_is_created_or_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    folder = make_folder(None)
    assert folder.parent == Path("runs")
    assert (folder / "logs").is_dir()
    assert make_folder(tmp_path / "a" / "b") == tmp_path / "a" / "b"
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match="--out"):
        make_folder(tmp_path / "file")
