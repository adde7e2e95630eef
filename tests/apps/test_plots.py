"""The pictures of a run and their content."""

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from armgate.apps.demo import plots
from armgate.apps.stack.metrics import columns, compute
from armgate.apps.stack.observation import Observation
from armgate.client import State

Make = Callable[..., State]


@pytest.fixture
def run(make_state: Make) -> Observation:
    seen = Observation("FR")
    for k in range(300):
        seen.take(make_state(k, angle=8.0 * np.exp(-k / 30), distance=0.05 * np.exp(-k / 30)))
    return seen


def test_four_pictures(run: Observation, tmp_path: Path) -> None:
    metrics = compute(run, 0.05, 1.0, True)
    drawn = plots.draw(columns(run.rows), metrics, tmp_path)
    names = ["angle_error.png", "distance_error.png", "leader_position.png", "clearance.png"]
    assert [file.name for file in drawn] == names
    for file in drawn:
        data = file.read_bytes()
        assert data.startswith(b"\x89PNG")
        assert min(struct.unpack(">II", data[16:24])) >= 400


@pytest.mark.parametrize("states", [1, 2])
def test_a_run_shorter_than_the_transient_is_drawn(make_state: Make, tmp_path: Path, states: int) -> None:
    seen = Observation("FR")
    for k in range(states):
        seen.take(make_state(k, angle=None))
    assert len(plots.draw(columns(seen.rows), compute(seen, 0.05, 0.0, False), tmp_path)) == 4


def test_an_empty_series_draws_nothing(tmp_path: Path) -> None:
    seen = Observation("FR")
    assert plots.draw(columns(seen.rows), compute(seen, 0.05, 0.0, False), tmp_path) == []


def test_axes_have_units_bands_and_the_shaded_approach(run: Observation) -> None:
    from matplotlib.figure import Figure

    metrics = compute(run, 0.05, 1.0, True)
    series = columns(run.rows)
    for paint, unit in (
        (plots._angle, "[°]"), (plots._distance, "[mm]"),
        (plots._position, "[m]"), (plots._clearance, "[mm]"),
    ):  # fmt: skip
        axes = Figure().subplots()
        paint(axes, series, metrics)
        assert unit in axes.get_ylabel()
        assert axes.get_title()
    axes = Figure().subplots()
    plots._angle(axes, series, metrics)
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert {"approach", "± 1°", "view angle"} <= set(labels)
    assert axes.get_ylim()[1] < 3.0  # the time after the transient fills the picture
