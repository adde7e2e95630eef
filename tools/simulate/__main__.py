"""Deterministic simulation of the stack: daemon, robot server, clients, network, clock and disk in one process.

    python -m tools.simulate [--seeds N | --seed S] [--first S] [--steps N] [--without 1,2] [--trace]

Everything in a simulation follows from its seed. A seed that violates an invariant is printed with its schedule
of faults and the command that repeats it. docs/simulation.md explains what is simulated and checked.
"""

import argparse
import logging
import sys
import time

from tools.simulate.machine import interposed

interposed.install()


def main() -> int:
    """Run simulations; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m tools.simulate", description="Simulate the stack.")
    parser.add_argument("--seeds", type=int, default=20, help="number of seeds")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--seed", type=int, help="run this seed only")
    parser.add_argument("--steps", type=int, default=1000, help="ticks of each simulation")
    parser.add_argument("--without", default="", help="numbers of faults that are left out")
    parser.add_argument("--trace", action="store_true", help="print the whole trace")
    given = parser.parse_args()
    logging.getLogger("asyncio").disabled = True  # clients write to connections that are lost
    from tools.simulate.run import Simulation

    seeds = [given.seed] if given.seed is not None else range(given.first, given.first + given.seeds)
    without = frozenset(int(n) for n in given.without.split(",") if n)
    failed = steps = 0
    begin = time.process_time()
    for seed in seeds:
        start = time.process_time()
        result = Simulation(seed, given.steps, without, keep=given.trace).run()
        spent = time.process_time() - start
        steps += result.steps
        print(f"seed {seed}: {result.steps} steps, {result.mode}, {spent:.2f} s, {result.figures}, {result.digest[:16]}")
        if given.trace:
            print("\n".join(result.trace))
        if result.violations:
            failed += 1
            for text in result.violations[:5]:
                print(f"  VIOLATION {text[:1500]}")
            for number, fault in enumerate(result.schedule):
                print(f"  {number:2} {fault}")
    print(f"{steps} steps, {failed} seeds failed, {time.process_time() - begin:.1f} s")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
