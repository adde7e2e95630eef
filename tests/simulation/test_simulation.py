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


def test_a_seed_gives_the_same_trace_in_another_process_after_other_seeds():
    first = simulate("--first", "20", "--seeds", "3", "--steps", "60", "--verbose", hash_seed="1")
    assert first.returncode == 0, first.stdout + first.stderr
    second = simulate("--first", "22", "--seeds", "1", "--steps", "60", "--verbose", hash_seed="2")
    assert len(hashes(second.stdout)) == 1, second.stdout + second.stderr
    assert hashes(first.stdout)[2:] == hashes(second.stdout)


@pytest.mark.slow
def test_no_seed_violates_an_invariant():
    done = simulate("--seeds", "20", "--steps", "800", "--first", "100", "--jobs", "2")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "0 seeds with violations" in done.stdout


@pytest.mark.slow
def test_a_seeded_bug_is_found():
    done = simulate("--bug", "fence not raised", "--seeds", "10", "--steps", "300")
    assert done.returncode == 1, done.stdout + done.stderr
    assert "violated: fences grow" in done.stdout
