"""Command line of the simulation."""

import argparse
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


def main() -> int:
    """Run simulations; return the exit status."""
    given = _parser().parse_args()
    if given.bugs:
        return find_all(given.seeds, given.jobs)
    logging.getLogger("asyncio").disabled = True  # clients write to connections that are lost
    prepare()
    seeds = [given.seed] if given.seed is not None else range(given.first, given.first + given.seeds)
    without = frozenset(int(number) for number in given.without.split(",") if number)
    failed = steps = 0
    begin = time.monotonic()
    for result in _results(seeds, given.steps, without, given.jobs, given.trace):
        steps += result.steps
        failed += bool(result.violations)
        if result.violations or given.seed is not None or given.verbose:
            _show(result, given.trace)
        if result.violations and given.bug:
            print(f"  violated: {result.violations[0][:300]}")
            return 1
        if result.violations:
            _explain(result, given.steps, without, shrink=not given.trace)
    seconds = time.monotonic() - begin
    print(f"{len(seeds)} seeds, {steps} steps, {failed} seeds with violations, {seconds:.1f} s")
    return 1 if failed else 0


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
    """Run one seed."""
    return Simulation(seed, steps, without, keep=keep).run()


def _show(result: Result, trace: bool) -> None:
    figures = f"{result.steps} steps, {result.mode}, {result.figures}"
    print(f"seed {result.seed}: {figures}, hash {result.digest}", flush=True)
    if trace:
        print("\n".join(result.trace))


def _explain(result: Result, steps: int, without: frozenset[int], *, shrink: bool) -> None:
    """Print violations, the last lines of the trace, the schedule and the command that repeats the seed."""
    for text in result.violations[:_SHOWN]:
        print(f"  violated: {text[:1000]}")
    if shrink:
        without = shrunk(result, steps, without)
    for number, fault in enumerate(result.schedule):
        print(f"  {' ' if number in without else '*'} {number:2}  {fault}")
    print("  faults marked * are needed; the end of the trace:")
    for line in result.trace[-_LINES:]:
        print(f"    {line[:200]}")
    left_out = f" --without {','.join(map(str, sorted(without)))}" if without else ""
    print(f"  repeat: python -m tools.simulate --seed {result.seed} --steps {steps}{left_out} --trace")
