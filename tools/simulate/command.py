"""Command line of the simulation."""

import argparse
import gc
import logging
import multiprocessing
import time
from collections.abc import Iterable, Iterator
from functools import partial

from armgate.gate import prepare
from tools.simulate.find_bugs import find_all
from tools.simulate.run import Result, Simulation
from tools.simulate.shrink import shrunk

_SHOWN = 5
_LINES = 40
_PROGRESS = 15.0
"""Time between two lines of progress, s."""


def main() -> int:
    """Run simulations; return the exit status."""
    given = _parser().parse_args()
    if given.bugs:
        return find_all(given.seeds, given.jobs)
    logging.getLogger("asyncio").disabled = True  # clients write to connections that are lost
    prepare()
    gc.freeze()  # simulations collect their own garbage only
    seeds = [given.seed] if given.seed is not None else range(given.first, given.first + given.seeds)
    without = frozenset(int(number) for number in given.without.split(",") if number)
    progress = Progress(len(seeds), show=given.seed is None and not given.bug)
    for result in _results(seeds, given.steps, without, given.jobs, given.trace):
        progress.add(result)
        if result.violations or given.seed is not None or given.verbose:
            _show(result, given.trace)
        if result.violations and given.bug:
            print(f"  violated: {result.violations[0][:300]}")
            return 1
        if result.violations:
            _explain(result, given.steps, without, shrink=not given.trace)
    print(progress.line)
    for seed in progress.failed:
        print(f"  replay: {_replay(seed, given.steps, without)}")
    return 1 if progress.failed else 0


class Progress:
    """Progress of a series of simulations, printed every ``_PROGRESS`` seconds.

    Args:
        seeds: Number of seeds.
        show: False to print nothing before the end.

    Attributes:
        failed: Seeds that violate an invariant.
    """

    def __init__(self, seeds: int, *, show: bool) -> None:
        self._seeds, self._show = seeds, show
        self._done = self._steps = 0
        self._begin = self._shown = time.monotonic()
        self.failed: list[int] = []

    def add(self, result: Result) -> None:
        """Count a simulation."""
        self._done += 1
        self._steps += result.steps
        if result.violations:
            self.failed.append(result.seed)
        if self._show and self._done < self._seeds and time.monotonic() > self._shown + _PROGRESS:
            self._shown = time.monotonic()
            print(f"{self._done} of {self.line}", flush=True)

    @property
    def line(self) -> str:
        """Line with the figures so far."""
        seconds = time.monotonic() - self._begin
        violations = f"{len(self.failed)} seeds with violations"
        return f"{self._seeds} seeds, {self._steps} steps, {violations}, {seconds:.1f} s"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m tools.simulate", description="Simulate the stack.")
    parser.add_argument("--seeds", type=int, default=20, help="number of seeds")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--seed", type=int, help="run only this seed, and show its figures")
    parser.add_argument("--steps", type=int, default=1000, help="ticks of robots in each simulation")
    parser.add_argument("--jobs", type=int, default=1, help="processes that run seeds at the same time")
    parser.add_argument("--without", default="", help="numbers of faults that are left out, as in 1,4")
    parser.add_argument("--bug", help="put this seeded bug into the sources, and end at its first violation")
    parser.add_argument("--bugs", action="store_true", help="find every seeded bug")
    parser.add_argument("--trace", action="store_true", help="print the whole trace")
    parser.add_argument("--verbose", action="store_true", help="print a line for each seed")
    return parser


def _results(
    seeds: Iterable[int], steps: int, without: frozenset[int], jobs: int, keep: bool
) -> Iterator[Result]:
    run = partial(simulate, steps=steps, without=without, keep=keep)
    if jobs == 1:
        yield from map(run, seeds)
        return
    with multiprocessing.get_context("fork").Pool(jobs) as pool:
        yield from pool.imap(run, seeds, chunksize=2)


def simulate(seed: int, steps: int, without: frozenset[int] = frozenset(), keep: bool = False) -> Result:
    """Run one seed.

    Raises:
        RuntimeError: The simulation itself has failed.
    """
    try:
        return Simulation(seed, steps, without, keep=keep).run()
    except Exception as error:
        raise RuntimeError(f"the simulation of seed {seed} has failed: {error!r}") from error


def _show(result: Result, trace: bool) -> None:
    figures = f"{result.steps} steps, {result.mode}, {result.figures}"
    print(f"seed {result.seed}: {figures}, hash {result.digest}", flush=True)
    if trace:
        print("\n".join(result.trace))


def _explain(result: Result, steps: int, without: frozenset[int], *, shrink: bool) -> None:
    """Print violations, the last lines of the trace, the schedule and the command that repeats the seed."""
    for text in result.violations[:_SHOWN]:
        print(f"  violated: {text[:1000]}")
    print(f"  replay: {_replay(result.seed, steps, without)}", flush=True)
    if shrink:
        without = shrunk(result, steps, without)
    for number, fault in enumerate(result.schedule):
        print(f"  {' ' if number in without else '*'} {number:2}  {fault}")
    print("  faults marked * are needed; the end of the trace:")
    for line in result.trace[-_LINES:]:
        print(f"    {line[:200]}")
    if shrink:
        print(f"  with the needed faults only: {_replay(result.seed, steps, without)}", flush=True)


def _replay(seed: int, steps: int, without: frozenset[int]) -> str:
    """Return the command that repeats a seed."""
    left_out = f" --without {','.join(map(str, sorted(without)))}" if without else ""
    return f'make simulate ARGS="--seed {seed} --steps {steps}{left_out} --trace"'
