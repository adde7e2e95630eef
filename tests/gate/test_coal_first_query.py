"""coal's results do not depend on the first query of a process, see ``_settle_coal``."""

import subprocess
import sys

import pytest

SCRIPT = """
import sys
import numpy as np
from armgate.cell.shapes import Box, Capsule
from armgate.gate.clearance.engines import CoalEngine

rng = np.random.default_rng(0)


def turned():
    R = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return R * np.linalg.det(R)


engine = CoalEngine((Capsule(0.1, 0.7), Box(1.0, 2.0, 0.5)))
first = np.eye(3) if sys.argv[1] == "same axes" else turned()
rng = np.random.default_rng(1)
engine.suggest(0, (first, np.zeros(3)), 1, (np.eye(3), np.array([3.0, 1.0, 0.0])))
for _ in range(300):
    found = engine.suggest(0, (turned(), rng.normal(size=3)), 1, (np.eye(3), rng.normal(size=3) * 3.0))
    print(repr(found.distance), found.normal.tolist())
"""


def results(first: str) -> str:
    return subprocess.run(
        [sys.executable, "-c", SCRIPT, first], check=True, capture_output=True, text=True, timeout=120
    ).stdout


@pytest.mark.slow
def test_the_first_query_of_a_process_has_no_effect() -> None:
    one, other = results("same axes"), results("other axes")
    assert one.count("\n") == 300
    assert one == other
