"""Cells and environments of the tests."""

import pytest

from support.cells import arms_yaml


@pytest.fixture
def arms(tmp_path):
    """Return the file of a cell with two planar arms, B three times as fast as A."""
    file = tmp_path / "arms.yaml"
    file.write_text(arms_yaml(periods=(0.012, 0.004), lag=0.03))
    return file


@pytest.fixture
def env(arms):
    """Return an environment of both arms without a task, which begins at the configured start."""
    from armgate.env import CellEnv

    made = CellEnv(arms)
    made.reset(seed=0)
    return made
