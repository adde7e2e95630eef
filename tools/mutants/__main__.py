"""How much of the gate's judgement the tests hold: faults put in one by one, and the share that is noticed.

    python -m tools.mutants [N] [--module NAME] [--seed S] [--tests FILE…] [--list]

N mutants are drawn by the seed, from all modules of ``armgate.integrity`` or from one; without N all are
tried. ``reasons.toml`` lists those that no test can kill, with the reason: they are told, and do not count.
Survivors that are not listed are printed last but one, the share killed last. The exit status is 1 if the
share is below the goal.
"""

import argparse
import random
import sys
import time
import tomllib
from pathlib import Path

from tools.mutants.mutate import Mutant, mutants_of
from tools.mutants.run import TESTS, Mutated, judge, preload, times

GOAL = 0.9
_FOLDER = Path("server/armgate/integrity")
_REASONS = Path(__file__).with_name("reasons.toml")
_PATIENCE = 4.0


def main() -> int:
    """Tries mutants."""
    args = _arguments()
    modules = sorted(p for p in _FOLDER.glob("*.py") if p.stem != "__init__")
    chosen = [p for p in modules if args.module in (None, p.stem)]
    if not chosen:
        print(f"no module {args.module!r}; expected one of {', '.join(p.stem for p in modules)}")
        return 2
    mutants = [(path, m) for path in chosen for m in mutants_of(path.stem, path.read_text("utf-8"))]
    reasons = _reasons()
    if args.list:
        print(*(m.key for _, m in mutants), sep="\n")
        return 0
    judged = [(path, m) for path, m in mutants if m.key not in reasons]
    if args.count and args.count < len(judged):
        judged = random.Random(args.seed).sample(judged, args.count)  # noqa: S311
    print(f"{len(mutants)} mutants, {len(mutants) - len(judged)} not tried here")
    return _tell(_tried(judged, args.tests), [m.key for _, m in mutants if m.key in reasons])


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tools.mutants")
    parser.add_argument("count", nargs="?", type=int, help="how many, drawn at random; all without it")
    parser.add_argument("--module", help="only this module, as in 'limits'")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--tests", nargs="+", default=list(TESTS))
    parser.add_argument("--list", action="store_true", help="print the mutants' keys and try none")
    return parser.parse_args()


def _reasons() -> dict[str, str]:
    """Why mutants are no faults, by key."""
    groups = tomllib.loads(_REASONS.read_text("utf-8"))["equivalent"]
    return {key: group["reason"] for group in groups for key in group["mutants"]}


def _tried(judged: list[tuple[Path, Mutant]], tests: list[str]) -> list[tuple[Mutant, str]]:
    preload()
    known = times(tests)
    most = _PATIENCE * sum(known.values()) + 30.0
    print(f"{len(known)} tests take {sum(known.values()):.0f} s without a fault")
    results = []
    for number, (path, mutant) in enumerate(judged, 1):
        began = time.monotonic()
        finder = Mutated(f"armgate.integrity.{path.stem}", path.absolute(), mutant.tree)
        result = judge(finder, tests, known, most)
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
    print(f"\n{len(excused)} mutants change nothing that matters: tools/mutants/reasons.toml says why")
    print(f"{len(survivors)} survived:")
    for mutant in survivors:
        print(f"  line {mutant.line}  {mutant.key}")
    print(f"killed: {killed} of {len(results)}, {share:.1%}")
    return 0 if share >= GOAL else 1


if __name__ == "__main__":
    sys.exit(main())
