"""Mutation testing of the gate: put small faults into it, one at a time, and count those that tests catch.

    python -m tools.mutants [N] [--module NAME…] [--seed S] [--tests FILE…] [--longest S] [--about]
                            [--only FILE] [--list]

N mutants are drawn by the seed, from all modules of ``armgate.gate`` or from some; without N all are
tried. ``--longest S`` leaves out tests that take longer than S seconds, ``--about`` all tests except those
about the module: a mutant that only such tests would catch counts as survived. ``--only`` tries the mutants
whose keys a file lists, such as survivors. ``reasons.toml`` lists equivalent mutants, which no test can
catch, with the reason; they are not tried and do not count. The output ends with the survivors and the share
killed. The exit status is 1 if the share is below the goal.
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
from tools.mutants.run import TESTS, Mutated, Order, preload, run_tests, tests_about, times

GOAL = 0.9
FOLDER = Path("server/armgate/gate")
_REASONS = Path(__file__).with_name("reasons.toml")
_HANGING = 4.0
"""A mutant is ended after this many times the duration of all tests without a fault."""

LEFT_OUT = {"__init__", "compiled", "compiled_nearest", "kernels"}
"""Modules without mutants. numba would load its code from its cache, without the fault; the compiled code
repeats the numpy code, and tests compare the two."""


def main() -> int:
    """Try mutants and print the result."""
    args = _arguments()
    modules = modules_of(FOLDER)
    unknown = set(args.module or ()) - {p.stem for p in modules}
    if unknown:
        expected = ", ".join(p.stem for p in modules)
        print(f"no module {', '.join(sorted(unknown))}; expected some of {expected}")
        return 2
    chosen = [p for p in modules if not args.module or p.stem in args.module]
    mutants = [(path, m) for path in chosen for m in mutants_of(path.stem, path.read_text("utf-8"))]
    reasons = _reasons()
    if args.list:
        print(*(m.key for _, m in mutants), sep="\n")
        return 0
    selected = [(path, m) for path, m in mutants if m.key not in reasons]
    if args.only:
        keys = set(args.only.read_text("utf-8").splitlines())
        selected = [(path, m) for path, m in selected if m.key in keys]
    if args.count and args.count < len(selected):
        selected = random.Random(args.seed).sample(selected, args.count)  # noqa: S311
    print(f"{len(mutants)} mutants, {len(mutants) - len(selected)} of them not tried")
    return _report(_try_all(selected, args), [m.key for _, m in mutants if m.key in reasons])


def modules_of(folder: Path) -> list[Path]:
    """Return the modules that are mutated, sorted by name; names are unique in the package."""
    return sorted((p for p in folder.rglob("*.py") if p.stem not in LEFT_OUT), key=lambda p: p.stem)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tools.mutants")
    parser.add_argument("count", nargs="?", type=int, help="number of mutants, drawn at random; default: all")
    parser.add_argument("--module", nargs="+", help="only these modules, as in 'joint_limits'")
    parser.add_argument("--seed", type=int, default=0, help="seed of the draw")
    parser.add_argument("--tests", nargs="+", default=list(TESTS), help="test files and folders")
    parser.add_argument("--longest", type=float, default=math.inf, help="leave out tests that take longer, s")
    parser.add_argument("--about", action="store_true", help="only the tests about the mutated module")
    parser.add_argument("--only", type=Path, help="file with the keys of the mutants to try, one per line")
    parser.add_argument("--list", action="store_true", help="print the mutants' keys and try none")
    return parser.parse_args()


def _reasons() -> dict[str, str]:
    """Return the reasons why mutants are equivalent, by key."""
    groups = tomllib.loads(_REASONS.read_text("utf-8"))["equivalent"]
    return {key: group["reason"] for group in groups for key in group["mutants"]}


def _try_all(selected: list[tuple[Path, Mutant]], args: argparse.Namespace) -> list[tuple[Mutant, str]]:
    preload()
    files = sorted({file for path, _ in selected for file in tests_about(path.stem)})
    known = times(files if args.about else args.tests)
    taken = [t for t in known.values() if t <= args.longest]
    most = _HANGING * sum(taken) + 30.0
    print(f"{len(taken)} tests take {sum(taken):.0f} s without a fault")
    results = []
    for number, (path, mutant) in enumerate(selected, 1):
        began = time.monotonic()
        finder = Mutated(_module_name(path), path.absolute(), mutant.tree)
        stages = [tests_about(path.stem), [] if args.about else args.tests]
        result = run_tests(finder, [s for s in stages if s], Order(known, args.longest), most)
        results.append((mutant, result))
        spent = time.monotonic() - began
        print(
            f"{number}/{len(selected)} {result} {spent:.1f} s  line {mutant.line}  {mutant.key}",
            flush=True,
        )
    return results


def _module_name(path: Path) -> str:
    return ".".join(["armgate.gate", *path.relative_to(FOLDER).with_suffix("").parts])


def _report(results: list[tuple[Mutant, str]], equivalent: list[str]) -> int:
    survivors = [m for m, result in results if result == "survived"]
    killed = len(results) - len(survivors)
    share = killed / max(len(results), 1)
    print(f"\n{len(equivalent)} mutants are equivalent; tools/mutants/reasons.toml gives the reasons")
    print(*_table([m.key for m, _ in results], equivalent, [m.key for m in survivors]), sep="\n")
    print(f"{len(survivors)} survived:")
    for mutant in survivors:
        print(f"  line {mutant.line}  {mutant.key}")
    print(f"killed: {killed} of {len(results)}, {share:.1%}")
    return 0 if share >= GOAL else 1


def _table(tried: list[str], equivalent: list[str], survivors: list[str]) -> Iterator[str]:
    """Return the result by module, in the form of docs/mutants.md."""
    columns = [Counter(key.split(":")[0] for key in keys) for keys in (tried, equivalent, survivors)]
    yield "| module | mutants | equivalent | killed | survived |"
    yield "|---|---:|---:|---:|---:|"
    modules = sorted(columns[0] | columns[1])
    for module in [*modules, "all"]:
        tries, same, lived = (c.total() if module == "all" else c[module] for c in columns)
        yield f"| {module} | {tries + same} | {same} | {tries - lived} | {lived} |"


if __name__ == "__main__":
    sys.exit(main())
