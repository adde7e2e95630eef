"""Shrinking of a failing seed: faults that are not needed for the violation are left out."""

from tools.simulate.run import Result, Simulation


def shrunk(result: Result, steps: int, without: frozenset[int]) -> frozenset[int]:
    """Return the numbers of the faults without which the seed still violates the same invariant.

    Args:
        result: Result of the seed.
        steps: Ticks of its simulation.
        without: Faults that are left out already.
    """
    invariant = _invariant(result)
    for number in range(len(result.schedule)):
        fewer = without | {number}
        if number not in without and _invariant(Simulation(result.seed, steps, fewer).run()) == invariant:
            without = fewer
    return without


def _invariant(result: Result) -> str:
    return result.violations[0].partition(":")[0] if result.violations else ""
