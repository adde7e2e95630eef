"""The tool that puts faults into the gate: its changes, its keys and its list of equivalent mutants."""

import ast
import tomllib
from pathlib import Path

from armgate.gate import braking
from tools.mutants.__main__ import FOLDER, modules_of
from tools.mutants.mutate import mutants_of
from tools.mutants.run import ABOUT

ROOT = Path(__file__).parents[2]
MODULES = {path.stem: path for path in modules_of(ROOT / FOLDER)}

SOURCE = '''
"""1 < 2"""
X: int = 3


def f(a: "1 + 1", b) -> "2 * 2":
    for x in a:
        if x < b and not x:
            continue
        g(min(x, -b))
        x += b
    text = f"{a} and {b}"
    return zip(a if b else x, text, strict=True)
'''


def test_each_mutant_is_one_change_with_a_key_of_its_own():
    found = mutants_of("m", SOURCE)
    keys = [m.key for m in found]
    assert len(set(keys)) == len(keys)
    assert [k.split(": ", 1)[1] for k in keys] == [
        "3 -> 4",
        "x < b and (not x) -> x < b or not x",
        "x < b -> x <= b",
        "x < b -> x >= b",
        "not x -> x",
        "continue -> break",
        "g(min(x, -b)) -> pass",
        "min -> max",
        "-b -> b",
        "x += b -> x -= b",
        "x += b -> x = b",
        "f'{a} and {b}' -> None",
        "zip(a if b else x, text, strict=True) -> zip(a if b else x, text)",
        "a if b else x -> a",
        "a if b else x -> x",
    ]
    original = ast.unparse(ast.parse(SOURCE)).splitlines()
    for mutant in found:
        changed = ast.unparse(mutant.tree).splitlines()
        assert sum(a != b for a, b in zip(original, changed, strict=True)) == 1


def test_unreachable_statements_are_not_changed():
    assert mutants_of("m", "assert_never(x)") == []


def test_mutants_of_the_gate_compile():
    for mutant in mutants_of("braking", Path(braking.__file__).read_text()):
        compile(mutant.tree, "braking", "exec")


def test_every_listed_equivalent_mutant_exists():
    """If a line of the gate changes, its entry in the list must be removed or changed too."""
    given = tomllib.loads((ROOT / "tools" / "mutants" / "reasons.toml").read_text())["equivalent"]
    listed = [key for group in given for key in group["mutants"]]
    assert len(set(listed)) == len(listed)
    there = set()
    for module in {key.split(":")[0] for key in listed}:
        there |= {mutant.key for mutant in mutants_of(module, MODULES[module].read_text())}
    assert set(listed) - there == set()
    assert all(group["reason"] for group in given)


def test_every_module_with_mutants_names_existing_tests_about_it():
    for name, path in MODULES.items():
        if mutants_of(name, path.read_text()):
            assert ABOUT.get(name), name
    for name in {name for names in ABOUT.values() for name in names}:
        assert (ROOT / "tests" / "gate" / f"test_{name}.py").exists(), name
