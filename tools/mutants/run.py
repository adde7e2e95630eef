"""Runs the tests against one mutant at a time, each in a fork of a process that has the libraries loaded.

A child sees the mutated module in the place of the one on disk, and ends with the first test that fails:
first those that are about its module, then all, the quickest first. One that takes far longer than all tests
did without a fault is ended: it hangs.
"""

import ast
import contextlib
import importlib.abc
import importlib.machinery
import json
import math
import os
import signal
import sys
import time
import types
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

TESTS = ("tests/gate",)
ABOUT = {
    "admission": ("gate_order", "gate_exact"),
    "beside": ("beside",),
    "bounds": ("bounds", "gate_exact"),
    "braking": ("limits_exact", "motion_math"),
    "certificate": ("certificate_exact", "shapes_certificates", "verdicts"),
    "clearance": (
        "clearance_exact",
        "groups_exact",
        "gate_exact",
        "verdicts",
        "retreat",
        "gate_order",
        "resets",
    ),
    "engine": ("certificate_exact", "shapes_certificates"),
    "gate": ("gate_order", "gate_exact", "gate_reserved", "faults", "resets"),
    "groups": ("groups_exact", "screen", "resets"),
    "judge": ("judge_exact", "gate_order", "retreat", "verdicts"),
    "lag": ("lag", "judge_exact"),
    "limits": ("limits_exact", "motion_math"),
    "nearest": ("nearest_exact", "gate_exact", "resets"),
    "occupancy": ("occupancy_exact", "motion_math", "lag"),
    "penetration": ("penetration",),
    "played": ("played", "gate_exact"),
    "question": ("clearance_exact", "groups_exact", "verdicts"),
    "range": ("range", "resets"),
    "replay": ("gate_order",),
    "reservations": ("gate_reserved", "gate_exact", "gate_order", "resets"),
    "rest": ("rest", "robot_exact"),
    "retreat": ("retreat", "gate_exact", "resets"),
    "robot": ("robot_exact", "gate_exact", "retreat", "faults", "gate_order", "beside", "range"),
    "screen": ("screen", "clearance_exact", "gate_exact"),
    "stops": ("stops", "gate_exact", "gate_order"),
    "support": ("groups_exact", "shapes_certificates"),
    "swept": ("groups_exact", "screen", "range", "resets"),
    "view": ("gate_exact", "gate_order"),
}
"""Test modules that are about a module of the gate: the likeliest to notice a fault in it."""

_WITHOUT = [f"-pno:{name}" for name in ("cacheprovider", "unraisableexception", "threadexception")]
"""What costs a third of a second in each process and judges nothing."""

_POLL = 0.02


class Mutated(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Gives one module from a syntax tree."""

    def __init__(self, name: str, path: Path, tree: ast.Module) -> None:
        self._name, self._path, self._tree = name, path, tree

    def find_spec(self, fullname: str, path: object, target: object = None) -> Any:
        """Knows one name."""
        if fullname != self._name:
            return None
        return importlib.machinery.ModuleSpec(fullname, self, origin=str(self._path))

    def exec_module(self, module: types.ModuleType) -> None:
        """Runs the tree."""
        exec(compile(self._tree, str(self._path), "exec"), module.__dict__)  # noqa: S102


class Order:
    """A pytest plugin: the quickest tests first, as far as they were timed; keeps what they take.

    Tests that take longer than ``longest`` are left out.
    """

    def __init__(self, known: dict[str, float], longest: float = math.inf) -> None:
        self.known, self.longest, self.seen = known, longest, dict[str, float]()

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Sorts."""
        items[:] = [item for item in items if self.known.get(item.nodeid, 0.0) <= self.longest]
        items.sort(key=lambda item: self.known.get(item.nodeid, 0.0))

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Keeps times."""
        self.seen[report.nodeid] = self.seen.get(report.nodeid, 0.0) + report.duration


def preload() -> None:
    """Imports once what every child needs and no mutant changes."""
    import coal  # noqa: F401, PLC0415
    import fcl  # noqa: F401, PLC0415
    import hypothesis  # noqa: PLC0415
    import hypothesis.stateful  # noqa: PLC0415

    import armgate.cell.cell  # noqa: PLC0415
    import armgate.cell.mesh.parts  # noqa: F401, PLC0415

    sys.path[:0] = [str(Path("tests").absolute()), str(Path.cwd())]
    import_module("gate.oracle")
    import_module("gate.scenes").mesh()  # its parts are kept
    os.environ.update(PYTEST_DISABLE_PLUGIN_AUTOLOAD="1", ARMGATE_NUMPY="1")
    phases = (hypothesis.Phase.explicit, hypothesis.Phase.generate)  # who fails need not fail beautifully
    hypothesis.settings.register_profile(
        "mutants", derandomize=True, database=None, deadline=None, phases=phases
    )
    hypothesis.settings.load_profile("mutants")


def times(tests: Sequence[str]) -> dict[str, float]:
    """How long each test takes without a fault, s.

    Raises:
        RuntimeError: Some test fails as it is: no mutant could be judged.
    """
    read, write = os.pipe()
    pid = os.fork()
    if pid == 0:
        os.close(read)
        order = Order({})
        code = _pytest(tests, order)
        with os.fdopen(write, "w") as pipe:
            json.dump([code, order.seen], pipe)
        os._exit(0)
    os.close(write)
    with os.fdopen(read) as pipe:
        code, seen = json.load(pipe)
    os.waitpid(pid, 0)
    if code:
        raise RuntimeError(f"the tests {' '.join(tests)} fail without any mutant: run them first")
    return {str(k): float(v) for k, v in seen.items()}


def judge(finder: Mutated, stages: Sequence[Sequence[str]], order: Order, most: float) -> str:
    """Returns ``killed``, ``hangs`` or ``survived``.

    Args:
        finder: The mutant.
        stages: What is run, one after the other.
        order: Times of the tests, for their order, and how long they may be.
        most: Seconds after which it hangs.
    """
    pid = os.fork()
    if pid == 0:
        os.setsid()
        sys.meta_path.insert(0, finder)
        code = 1
        with contextlib.suppress(BaseException):
            code = int(any(_pytest(tests, order) for tests in stages))
        os._exit(code)
    until = time.monotonic() + most
    while time.monotonic() < until:
        done, status = os.waitpid(pid, os.WNOHANG)
        if done:
            return "survived" if status == 0 else "killed"
        time.sleep(_POLL)
    os.killpg(pid, signal.SIGKILL)
    os.waitpid(pid, 0)
    return "hangs"


def _pytest(tests: Sequence[str], order: Order) -> int:
    with open(os.devnull, "w", encoding="utf-8") as sink:
        os.dup2(sink.fileno(), 1)
        os.dup2(sink.fileno(), 2)
        options = ["-x", "-q", "--no-header", "--tb=no", "--assert=plain", "-c", os.devnull, "--rootdir=."]
        options += ["--import-mode=importlib", "-p", "_hypothesis_pytestplugin", *_WITHOUT]
        code = int(pytest.main([*options, *tests], plugins=[order]))
        return 0 if code == pytest.ExitCode.NO_TESTS_COLLECTED else code


def about(module: str) -> list[str]:
    """The test files that are about a module of the gate, as far as there are any."""
    files = [Path("tests/gate") / f"test_{name}.py" for name in ABOUT.get(module, ())]
    return [str(file) for file in files if file.exists()]
