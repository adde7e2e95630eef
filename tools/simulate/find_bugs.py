"""Search for all seeded bugs, each in processes of its own."""

import re
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor

from tools.simulate.bugs import BUGS, Bug

STEPS = 300
"""Ticks of each simulation."""

LONGEST = 600.0
"""Longest time of the search for one bug, s."""

_FOUND = re.compile(r"^seed (\d+):.*\n  violated: (.*)$", re.MULTILINE)


def find_all(seeds: int, jobs: int) -> int:
    """Search for every bug; return the exit status, 1 if one was not found.

    Args:
        seeds: Largest number of seeds for each bug.
        jobs: Bugs that are searched for at the same time.
    """
    missed = 0
    with ThreadPoolExecutor(jobs) as pool:
        for bug, (seed, text, seconds) in zip(
            BUGS, pool.map(lambda bug: _find(bug, seeds), BUGS), strict=True
        ):
            missed += seed is None
            found = "NOT FOUND" if seed is None else f"found by seed {seed}"
            print(f"{bug.name}: {found}, {seconds:.0f} s  {text[:160]}", flush=True)
    print(f"{len(BUGS) - missed} of {len(BUGS)} bugs found")
    return 1 if missed else 0


def _find(bug: Bug, seeds: int) -> tuple[int | None, str, float]:
    """Return the first seed that violates an invariant, its first violation, and the time it took, s."""
    begin = time.monotonic()
    options = ["--bug", bug.name, "--seeds", str(seeds), "--steps", str(STEPS)]
    command = [sys.executable, "-m", "tools.simulate", *options]
    try:
        done = subprocess.run(  # noqa: S603
            command, capture_output=True, text=True, check=False, timeout=LONGEST
        )
    except subprocess.TimeoutExpired:
        return None, "the search did not end", LONGEST
    seconds = time.monotonic() - begin
    if done.returncode not in (0, 1) or done.stderr:
        raise RuntimeError(f"{bug.name}: {done.stderr[-2000:]}")
    found = _FOUND.search(done.stdout)
    return (None, "", seconds) if found is None else (int(found[1]), found[2], seconds)
