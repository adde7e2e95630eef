"""Simulations of the stack: no invariant is violated, and a seed gives the same trace in every process."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def simulate(*options, hash_seed="1"):
    return subprocess.run(
        [sys.executable, "-m", "tools.simulate", *options],
        check=False,
        cwd=ROOT,
        env=os.environ | {"PYTHONHASHSEED": hash_seed},
        capture_output=True,
        text=True,
        timeout=600,
    )


def hashes(text):
    return [line for line in text.splitlines() if "hash" in line]


@pytest.mark.parametrize(
    ("count", "steps"), [("3", "150"), pytest.param("20", "1000", marks=pytest.mark.slow)]
)
def test_no_seed_violates_an_invariant(count, steps):
    done = simulate("--seeds", count, "--steps", steps, "--first", "100", "--jobs", "2")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "0 seeds with violations" in done.stdout


def test_a_seed_gives_the_same_trace_in_another_process_after_other_seeds():
    first = simulate("--first", "20", "--seeds", "3", "--steps", "60", "--verbose", hash_seed="1")
    second = simulate("--first", "22", "--seeds", "1", "--steps", "60", "--verbose", hash_seed="2")
    assert len(hashes(second.stdout)) == 1, second.stdout + second.stderr
    assert hashes(first.stdout)[2:] == hashes(second.stdout)
