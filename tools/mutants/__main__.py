"""Mutation testing of the gate: put small faults into it, one at a time, and count those that tests catch.

    python -m tools.mutants [N] [--module NAME…] [--seed S] [--tests FILE…] [--longest S] [--about]
                            [--only FILE] [--list]

N mutants are drawn by the seed, from all modules of ``armgate.gate`` or from some; without N all are
tried. ``--longest`` leaves out tests that take longer, ``--about`` all tests but those about the module: a
mutant that only these would catch counts as survived. ``--only`` tries the mutants whose keys a file lists,
such as survivors. ``reasons.toml`` lists equivalent mutants, which no test can catch, with the reason; they
are not tried and do not count. Survivors are printed last but one, the share killed last. The exit status is
1 if the share is below the goal.
"""

import argparse
import math
import random
import sys
import time
import tomllib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from tools.mutants.mutate import Mutant, mutants_of
from tools.mutants.run import TESTS, Mutated, Order, about, judge, preload, times

GOAL = 0.9
_FOLDER = Path("server/armgate/gate")
_REASONS = Path(__file__).with_name("reasons.toml")
_PATIENCE = 4.0
LEFT_OUT = {"__init__", "compiled", "kernels"}
"""The code that numba compiles repeats the readable form, and its tests compare the two; numba would load it
from its cache, without the fault."""


def main() -> int:
    """Try mutants and print the result."""
    args = _arguments()
    modules = sorted(p for p in _FOLDER.glob("*.py") if p.stem not in LEFT_OUT)
    unknown = set(args.module or ()) - {p.stem for p in modules}
    if unknown:
        print(
            f"no module {', '.join(sorted(unknown))}; expected some of {', '.join(p.stem for p in modules)}"
        )
        return 2
    chosen = [p for p in modules if not args.module or p.stem in args.module]
    mutants = [(path, m) for path in chosen for m in mutants_of(path.stem, path.read_text("utf-8"))]
    reasons = _reasons()
    if args.list:
        print(*(m.key for _, m in mutants), sep="\n")
        return 0
    judged = [(path, m) for path, m in mutants if m.key not in reasons]
    if args.only:
        keys = set(args.only.read_text("utf-8").splitlines())
        judged = [(path, m) for path, m in judged if m.key in keys]
    if args.count and args.count < len(judged):
        judged = random.Random(args.seed).sample(judged, args.count)  # noqa: S311
    print(f"{len(mutants)} mutants, {len(mutants) - len(judged)} not tried here")
    return _tell(_tried(judged, args), [m.key for _, m in mutants if m.key in reasons])


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tools.mutants")
    parser.add_argument("count", nargs="?", type=int, help="how many, drawn at random; all without it")
    parser.add_argument("--module", nargs="+", help="only these modules, as in 'limits'")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--tests", nargs="+", default=list(TESTS))
    parser.add_argument("--longest", type=float, default=math.inf, help="leave out tests that take longer, s")
    parser.add_argument("--about", action="store_true", help="only the tests that are about the module")
    parser.add_argument("--only", type=Path, help="a file with the keys of those to try, one a line")
    parser.add_argument("--list", action="store_true", help="print the mutants' keys and try none")
    return parser.parse_args()


def _reasons() -> dict[str, str]:
    """Return the reasons why mutants are equivalent, by key."""
    groups = tomllib.loads(_REASONS.read_text("utf-8"))["equivalent"]
    return {key: group["reason"] for group in groups for key in group["mutants"]}


def _tried(judged: list[tuple[Path, Mutant]], args: argparse.Namespace) -> list[tuple[Mutant, str]]:
    preload()
    chosen = sorted({file for path, _ in judged for file in about(path.stem)})
    known = times(chosen if args.about else args.tests)
    taken = [t for t in known.values() if t <= args.longest]
    most = _PATIENCE * sum(taken) + 30.0
    print(f"{len(taken)} tests take {sum(taken):.0f} s without a fault")
    results = []
    for number, (path, mutant) in enumerate(judged, 1):
        began = time.monotonic()
        finder = Mutated(f"armgate.gate.{path.stem}", path.absolute(), mutant.tree)
        stages = [about(path.stem), [] if args.about else args.tests]
        result = judge(finder, [s for s in stages if s], Order(known, args.longest), most)
        results.append((mutant, result))
        spent = time.monotonic() - began
        print(
            f"{number}/{len(judged)} {result} {spent:.1f} s  line {mutant.line}  {mutant.key}",
            flush=True,
        )
    return results


def _tell(results: list[tuple[Mutant, str]], excused: list[str]) -> int:
    survivors = [m for m, result in results if result == "survived"]
    killed = len(results) - len(survivors)
    share = killed / max(len(results), 1)
    print(f"\n{len(excused)} mutants are equivalent; tools/mutants/reasons.toml gives the reasons")
    print(*_table([m.key for m, _ in results], excused, [m.key for m in survivors]), sep="\n")
    print(f"{len(survivors)} survived:")
    for mutant in survivors:
        print(f"  line {mutant.line}  {mutant.key}")
    print(f"killed: {killed} of {len(results)}, {share:.1%}")
    return 0 if share >= GOAL else 1


def _table(tried: list[str], excused: list[str], survivors: list[str]) -> Iterator[str]:
    """Return the result by module, as docs/mutants.md shows it."""
    columns = [Counter(key.split(":")[0] for key in keys) for keys in (tried, excused, survivors)]
    yield "| module | mutants | equivalent | killed | survived |"
    yield "|---|---:|---:|---:|---:|"
    modules = sorted(columns[0] | columns[1])
    for module in [*modules, "all"]:
        tries, idle, lived = (c.total() if module == "all" else c[module] for c in columns)
        yield f"| {module} | {tries + idle} | {idle} | {tries - lived} | {lived} |"


if __name__ == "__main__":
    sys.exit(main())
