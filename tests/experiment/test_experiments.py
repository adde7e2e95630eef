"""Experiments without running processes: files, paths, starts, figures, claims, pages."""

import json
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest
from matplotlib import pyplot as plt

from armgate.apps.default_files import default_file
from armgate.apps.errors import AppError, UsageError
from armgate.apps.stack.observation import COLUMNS, Observation
from armgate.apps.stack.run_folder import write_series
from armgate.cell.errors import ConfigError
from armgate.experiment import campaign
from armgate.experiment.claims import Claim, aggregate, claims
from armgate.experiment.experiment_file import load_experiment
from armgate.experiment.figures import evaluate, recently
from armgate.experiment.paths import dash, joystick, straight
from armgate.experiment.plots import _enlarge
from armgate.experiment.report import page
from armgate.experiment.scene import Scene, build_scene, clear
from armgate.experiment.trial_run import plan
from armgate.experiment.trials import DistanceRange, Trial, trials

T = 0.012
ATTACKED = "link_1"  # link that the leader approaches with the first seed
MIDDLE, HALF = np.array([2.0, 0.0, 1.0]), np.array([0.3, 0.7, 0.35])


@pytest.fixture(scope="module")
def scene() -> Scene:
    return build_scene((default_file("demo.yaml"),))


# --- files and runs -----------------------------------------------------------------------------------------


def test_an_error_in_a_file_names_its_line(tmp_path: Path) -> None:
    file = tmp_path / "x.yaml"
    file.write_text("armgate: 1\nexperiment: zoom\nseeds: none\n")
    with pytest.raises(ConfigError, match=r"(?s)x\.yaml:1: speed: .*x\.yaml:3: seeds: 'none'"):
        load_experiment(file)
    file.write_text("armgate: 1\nexperiment: juggling\n")
    with pytest.raises(ConfigError, match=r"x\.yaml:2: experiment: .*'approach', 'tracking'"):
        load_experiment(file)


@pytest.mark.daily(2)
@pytest.mark.parametrize(
    ("name", "runs"), [("approach", 3 + 6), ("tracking", 9 * 3), ("zoom", 3), ("collision", 4 * 3)]
)
def test_the_bundled_experiment_files_are_valid(scene: Scene, name: str, runs: int) -> None:
    found = trials(load_experiment(default_file(f"experiments/{name}.yaml")), scene, seeds=3)
    assert len({trial.name for trial in found}) == len(found) == runs
    low, high = scene.reach()
    for trial in found:
        assert trial.start is None or clear(scene, trial.start)
        assert trial.path is None or ((trial.path >= low - 0.02) & (trial.path <= high + 0.02)).all()


def test_a_trial_becomes_processes_and_files(scene: Scene, tmp_path: Path) -> None:
    path = straight(scene.tool, scene.tool + np.array([0.0, 0.1, 0.0]), 0.25, T)
    trial = Trial("zoom", 7, 0.12, 1.0, path=path, zoom=DistanceRange(0.5, 1.3, 0.1))
    planned = plan(trial, scene, tmp_path, realtime=False)
    assert planned.daemon()[-2:] == ["--lockstep", "leader,follower,operator"]
    follow = planned.controller("follower", "h:1")
    assert follow[:8] == ["follow", "h:1", "--robot", "FR", "--leader", "GR", "--lag", "0.12"]
    assert planned.controller("operator", "h:1") == [
        "zoom", "h:1", "--low", "0.5", "--high", "1.3", "--rate", "0.1", "--start", "1.0", "--seed", "7",
        "--name", "operator",
    ]  # fmt: skip
    moved = build_scene((*scene.configs, tmp_path / "overlay.yaml"))
    np.testing.assert_allclose(moved.tool, path[0], atol=1e-12)
    assert moved.follower.config.link.lag == 0.12


def test_a_pursuit_starts_where_the_dash_with_the_same_seed_starts(scene: Scene, tmp_path: Path) -> None:
    found = trials(load_experiment(default_file("experiments/collision.yaml")), scene, seeds=1)
    dashed, pursued = (next(t for t in found if t.case == f"{kind}-0.5") for kind in ("dash", "pursuit"))
    assert dashed.path is not None
    assert pursued.seconds == 14.0
    planned = plan(pursued, scene, tmp_path, realtime=False)
    lead = planned.controller("leader", "h:1")
    assert lead[:6] == ["lead", "h:1", "--robot", "GR", "--pursue", f"FR/{ATTACKED}"]
    assert lead[6:8] == ["--tool-speed", "0.5"]
    moved = build_scene((*scene.configs, tmp_path / "overlay.yaml"))
    np.testing.assert_allclose(moved.tool, dashed.path[0], atol=1e-12)


def test_a_leader_without_prismatic_axes_is_refused(tmp_path: Path) -> None:
    other = tmp_path / "other.yaml"
    other.write_text("armgate: 1\nrobots: {FR: {camera: null}, GR: {camera: tool0}}\n")
    with pytest.raises(UsageError, match="'FR' cannot lead"):
        build_scene((default_file("demo.yaml"), other))


# --- paths ------------------------------------------------------------------------------------------------


@pytest.mark.daily(1)
@pytest.mark.parametrize("speed", [0.25, 1.0])
def test_the_joystick_moves_the_tool_smoothly_within_its_box(speed: float) -> None:
    for seed in range(5):
        path = joystick(seed, speed, MIDDLE, HALF, seconds=20.0, period=T)
        velocity = np.diff(path, axis=0) / T
        assert np.linalg.norm(velocity, axis=1).max() == pytest.approx(speed, rel=0.01)
        assert np.abs(np.diff(velocity, axis=0)).max() / T < 4.0
        assert np.linalg.norm(velocity[-1]) < 0.03 * speed
        assert (np.abs(path - MIDDLE) < HALF + 0.3).all()
        np.testing.assert_array_equal(path, joystick(seed, speed, MIDDLE, HALF, seconds=20.0, period=T))


def test_a_dash_is_straight_and_has_the_requested_length(scene: Scene) -> None:
    low, high = scene.reach()
    begin, end = dash(np.array([0.5, 0.2, 0.9]), 3, 2.5, low, high)
    assert np.linalg.norm(end - begin) == pytest.approx(2.5)
    steps = np.linalg.norm(np.diff(straight(begin, end, 0.5, T), axis=0), axis=1)
    np.testing.assert_allclose(steps, 0.5 * T, rtol=0.01)
    with pytest.raises(ValueError, match="no straight line of 9 m"):
        dash(end, 3, 9.0, low, high)


# --- figures ------------------------------------------------------------------------------------------------


def observed(**columns: Any) -> Observation:
    """Return a run of four seconds whose values are zero unless given."""
    count = 400
    table = {name: np.zeros(count) for name in COLUMNS} | {"time_s": 0.01 * np.arange(count)}
    table |= {name: np.broadcast_to(values, count) for name, values in columns.items()}
    seen = Observation("FR")
    seen.rows = [tuple(row) for row in np.array([table[name] for name in COLUMNS]).T]
    seen.positions = [(0.0,)] * count
    return seen


def test_recently_extends_a_condition() -> None:
    time = np.arange(6.0)
    assert recently(time, time == 1.0, 2.0).tolist() == [False, True, True, True, False, False]


def test_an_approach_that_rises_or_does_not_settle_is_detected() -> None:
    fall = np.radians(np.linspace(60.0, 0.0, 400))
    good = evaluate(Trial("approach", 0, 0.0, 1.0), observed(angle_error_rad=fall))
    assert (good["rise_deg"], good["start_angle_deg"]) == (0.0, pytest.approx(60.0))
    assert good["settled_s"] == pytest.approx(3.99, abs=0.02)
    bad = evaluate(Trial("approach", 0, 0.0, 1.0), observed(angle_error_rad=fall[::-1], distance_error_m=0.1))
    assert bad["rise_deg"] == pytest.approx(60.0)
    assert bad["settled_s"] is None


def test_errors_of_a_tour_count_from_two_seconds_until_the_joystick_is_released() -> None:
    time = 0.01 * np.arange(400)
    angle = np.radians(np.where(time < 1.9, 90.0, np.where(time > 2.05, 45.0, 3.0)))
    assert evaluate(Trial("slow", 0, 0.0, 1.0), observed(angle_error_rad=angle)) == {"moving_rms_deg": None}
    longer = observed(angle_error_rad=angle, time_s=2.0 * time)
    assert evaluate(Trial("slow", 0, 0.0, 1.0), longer)["moving_rms_deg"] > 45.0


def test_the_angle_in_a_dash_counts_unless_the_gate_or_the_emergency_mode_acts() -> None:
    time = 0.01 * np.arange(400)
    peak = np.where(np.abs(time - 3.0) < 0.1, np.radians(5.0), 0.0)
    trial = Trial("dash-0.5", 0, 0.03, 1.0)
    free = evaluate(trial, observed(angle_error_rad=peak))
    assert (free["free_angle_deg"], free["follower_refused"]) == (pytest.approx(5.0), False)
    refused = np.where(np.abs(time - 2.5) < 0.1, 2.0, 0.0)
    excused = evaluate(trial, observed(angle_error_rad=peak, gate_follower=refused))
    assert (excused["free_angle_deg"], excused["follower_refused"]) == (0.0, True)


def test_the_distance_during_a_zoom_counts_only_without_recent_repulsion() -> None:
    time = 0.01 * np.arange(400)
    pushed = (time > 2.1) & (time < 2.5)
    found = evaluate(
        Trial("zoom", 0, 0.03, 1.0, zoom=DistanceRange(0.5, 1.3, 0.1)),
        observed(repulsion=pushed, distance_error_m=0.3 * (time > 2.2)),
    )
    assert found["quiet_distance_m"] == 0.0
    assert 0.0 < found["quiet_share"] < 0.1


# --- claims -------------------------------------------------------------------------------------------------


def entry(case: str, **changes: Any) -> dict[str, Any]:
    one = {
        "case": case, "seed": 1, "angle_error_deg": {"max": 0.1, "rms": 0.05}, "stop_distance_m": 0.05,
        "distance_error_m": {"max": 0.001, "rms": 0.0005}, "min_clearance_m": 0.2, "late_commands": 0,
        "states_missed": {}, "moving_rms_deg": 0.05, "duration_s": 2.0, "realtime_factor": 4.0,
        "verdicts": {"FR": {"admitted": 5, "limited": {"acceleration": 2}, "refused": {}}},
    }  # fmt: skip
    return one | changes


def dashed(refused: int, of: int, **changes: Any) -> list[dict[str, Any]]:
    common = {"free_angle_deg": 0.2, "leader_refused": True} | changes
    return [entry("dash-0.5", follower_refused=k < refused, **common) for k in range(of)]


def holding(rows: Any, text: str) -> bool | None:
    (found,) = [row.holds for row in rows if text in row.claim]
    return found  # type: ignore[no-any-return]


def test_claims_hold_as_long_as_every_run_does() -> None:
    rows = claims("tracking", [entry("slow"), entry("slow", angle_error_deg={"max": 0.9, "rms": 0.5})])
    assert holding(rows, "0.25 m/s, no lag, without prediction: angle") is True
    assert holding(rows, "0.5 m/s, no lag, with prediction: angle") is None  # not checked
    rows = claims("tracking", [entry("slow"), entry("slow", angle_error_deg={"max": 1.1, "rms": 0.5})])
    assert holding(rows, "0.25 m/s, no lag, without prediction: angle") is False
    rows = claims("tracking", [entry("slow", angle_error_deg={"max": None, "rms": None})])
    assert holding(rows, "0.25 m/s, no lag, without prediction: angle") is False  # did not settle


def test_prediction_is_compared_seed_by_seed() -> None:
    without = entry("fast", moving_rms_deg=0.6)
    for rms, holds in ((0.19, True), (0.21, False)):
        rows = claims("tracking", [without, entry("fast-predicted", moving_rms_deg=rms)])
        assert holding(rows, "0.5 m/s: ratio") is holds


@pytest.mark.parametrize(("refused", "holds"), [(4, True), (5, False)])
def test_the_follower_may_be_refused_in_a_tenth_of_the_dashes(refused: int, holds: bool) -> None:
    assert holding(claims("collision", dashed(refused, 40)), "follower is refused") is holds


def test_a_pursuit_is_only_reported() -> None:
    entries = [entry("pursuit-0.5", follower_refused=k > 0, leader_refused=True) for k in range(4)]
    refused, leader = claims("collision", entries)[:2]
    assert (refused.value, refused.goal, refused.holds) == (0.75, "reported", None)
    assert (leader.value, leader.holds) == (1.0, None)


def test_claims_of_every_run() -> None:
    rows = claims("collision", dashed(0, 2, min_clearance_m=0.049, late_commands=1, states_missed={"FR": 3}))
    assert [row.holds for row in rows[-3:]] == [False, False, False]
    assert [row.holds for row in claims("collision", dashed(0, 2))[-3:]] == [True, True, True]


def test_the_runs_of_a_case_are_aggregated() -> None:
    sums = aggregate([entry("slow"), entry("slow", min_clearance_m=0.1), entry("fast")])
    assert list(sums) == ["slow", "fast"]
    assert (sums["slow"]["runs"], sums["slow"]["min_clearance_m"]) == (2, 0.1)
    assert sums["slow"]["limited"] == {"FR": 4}
    assert sums["slow"]["realtime_factor"] == pytest.approx(4.0)


def test_the_report_page_is_self_contained(tmp_path: Path) -> None:
    picture = tmp_path / "p.png"
    picture.write_bytes(b"\x89PNG")
    entries = dashed(1, 2)
    text = page("collision", claims("collision", entries), aggregate(entries), [("<dash>", picture)])
    assert "data:image/png;base64,iVBORw==" in text
    assert "&lt;dash&gt;" in text
    assert "does not hold" in text
    assert "http" not in text
    assert '<td class="g">≥ 50 mm</td><td class="n">200 mm</td>' in text


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (0.016073, "m", "16.1 mm"),
        (1.7082, "m", "1708 mm"),
        (0.83584, "°", "0.836°"),
        (1 / 3, "", "0.333"),
        (1.476, "s", "1.48 s"),
        (1234.0, "commands", "1234"),
        (None, "m", "–"),
    ],
)
def test_figures_have_three_digits(value: float | None, unit: str, text: str) -> None:
    assert Claim("it", "", value, unit, None).text == text


def test_the_initial_angle_does_not_hide_the_later_one() -> None:
    time = np.arange(0.0, 8.0, T)
    run = {name: np.zeros(len(time)) for name in COLUMNS} | {"time_s": time}
    angle = np.radians(np.where(time < 0.5, 7.0, 0.03 * np.sin(time)))
    figure, axes = plt.subplots()
    _enlarge(axes, run | {"angle_error_rad": angle})
    assert axes.get_ylim()[1] == pytest.approx(0.07)
    assert [text.get_text() for text in axes.texts] == ["initially up to 7.0°"]
    plt.close(figure)


# --- an incomplete campaign -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("end", "ended"),
    [
        (None, "1 of 3 runs, then: interrupted"),
        (KeyboardInterrupt(), "1 of 3 runs, then: interrupted"),
        (
            AppError("the daemon was killed"),
            "1 of 3 runs, then: the daemon was killed",
        ),
    ],
    ids=["interrupted in a run", "interrupted between runs", "failed"],
)
def test_finished_runs_are_evaluated_after_any_end(
    scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, end: BaseException | None, ended: str
) -> None:
    def play(trial: Trial, _scene: Scene, folder: Path, *_: Any, **__: Any) -> dict[str, Any] | None:
        if trial.seed > first:
            if end is not None:
                raise end
            return None
        folder.mkdir(parents=True)
        write_series(folder, observed().rows)
        zoomed = {"zoom_angle_deg": 0.1, "quiet_distance_m": 0.001, "quiet_share": 0.9}
        return entry("zoom", seed=trial.seed, **zoomed)

    monkeypatch.setattr(campaign, "play", play)
    monkeypatch.setattr(campaign, "ForkServer", MagicMock())
    setups = {
        name: load_experiment(default_file(f"experiments/{name}.yaml")) for name in ("zoom", "tracking")
    }
    first = setups["zoom"].first_seed
    course = campaign.Campaign(scene, tmp_path, campaign.Options(seeds=3, sockets=True))
    assert course.run(setups) == ended
    together = json.loads((tmp_path / "metrics.json").read_text())
    assert (together["complete"], together["holds"]) == (False, None)
    assert together["ended"] == ended
    assert {row["experiment"] for row in together["claims"]} == {"zoom"}
    found = json.loads((tmp_path / "zoom" / "metrics.json").read_text())
    assert [one["seed"] for one in found["entries"]] == [first]
    assert found["aggregate"]["zoom"]["runs"] == 1
    assert f"Incomplete:</b> {ended}" in (tmp_path / "zoom" / "report.html").read_text()
    assert not (tmp_path / "tracking").exists()
