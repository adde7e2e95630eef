"""Search for valid messages that make the daemon violate its specification.

``python -m tools.fuzz.valid [RUNS [SEED]]``: send RUNS messages to cores in memory, in cells of 1 to 32
robots with up to 64 joints, by the wall clock and in lock-step. The exit status is 0, or 1 with the seed of a
failure.
"""

import asyncio
import sys
import tempfile
import time
import traceback
from pathlib import Path
from random import Random

from tools.fuzz.valid.rig import Rig

_ROBOTS = (1, 2, 2, 2, 3, 3, 4, 8, 32)
_JOINTS = (1, 3, 6, 6, 7, 12, 40, 64)
_EPISODE, _LEAST = 8000, 150
"""Number of messages to a small cell, and to the largest, whose ticks take longer."""


def main(arguments: list[str]) -> int:
    """Return the exit status."""
    if len(arguments) > 2 or not all(argument.isdecimal() for argument in arguments):
        print(__doc__, file=sys.stderr)
        return 2
    given = [int(argument) for argument in arguments]
    runs, seed = (*given, *(100_000, 0)[len(given) :])
    return asyncio.run(search(runs, seed))


async def search(runs: int, seed: int) -> int:
    """Send ``runs`` messages; return the exit status."""
    sent, began = 0, time.monotonic()
    while sent < runs:
        try:
            count, what = episode(seed, runs - sent)
        except Exception:
            print(f"fuzz-valid: {seed=}\n{traceback.format_exc()}", file=sys.stderr)
            return 1
        sent, seed = sent + count, seed + 1
        print(f"fuzz-valid: {sent} messages, {what}, {time.monotonic() - began:.0f} s", flush=True)
    print(f"fuzz-valid: {sent} valid messages in {time.monotonic() - began:.0f} s, nothing found")
    return 0


def episode(seed: int, most: int) -> tuple[int, str]:
    """Send at most ``most`` messages to one cell; return their number and a description of the cell.

    Raises:
        ViolationError: The daemon violated the specification.
    """
    rng = Random(seed)  # noqa: S311 (a reproducible search)
    robots, joints, lockstep = rng.choice(_ROBOTS), rng.choice(_JOINTS), rng.random() < 0.3
    count = min(most, max(_LEAST, _EPISODE // max(1, robots * joints // 8)))
    with tempfile.TemporaryDirectory() as folder:
        Rig(Path(folder), rng, robots, joints, lockstep=lockstep).run(count)
    return count, f"seed {seed}: {robots} robots of up to {joints} joints{', in lock-step' * lockstep}"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
