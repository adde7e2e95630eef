"""The operator's schedule."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from armgate.apps.zoom.schedule import DistanceSchedule, ZoomProgram
from armgate.client.program import run


@pytest.mark.parametrize("seed", range(5))
def test_distances_stay_within_bounds_and_change_at_their_rate(seed: int) -> None:
    schedule = DistanceSchedule(0.5, 1.3, 1.0, 0.1, seed)
    distances = np.array([schedule.at(0.012 * k) for k in range(5000)])
    assert distances[0] == 1.0
    assert 0.5 <= distances.min() < 0.7
    assert 1.1 < distances.max() <= 1.3
    steps = np.abs(np.diff(distances))
    assert steps.max() <= 0.1 * 0.012 + 1e-12
    assert (steps == 0.0).any()


def test_distances_are_shared_when_they_change_and_each_step_is_passed() -> None:
    calls: list[Any] = []
    cell: Any = SimpleNamespace(
        subscribe=lambda **_: None,
        states=lambda: (
            SimpleNamespace(robot="P", time=5.0 + 0.1 * k, step=k) for k in range(1000) for _ in range(2)
        ),
        signal=lambda name, value, more: calls.append((name, value)),
        skip=lambda: calls.append("skip"),
    )
    run(cell, None, ZoomProgram(DistanceSchedule(0.5, 1.3, 1.0, 0.1, 3), 3.0))
    assert calls[:3] == [("operator.distance", 1.0), "skip", "skip"]
    assert calls.count("skip") == 30
    assert 5 < len(calls) - 30 < 25
