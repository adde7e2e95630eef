"""Run of the tests against one mutant at a time, each in a fork of a process that has the libraries loaded.

The fork imports the mutated module instead of the one on disk, and ends with the first test that fails. The
tests about the module run first, then all, the quickest first. A mutant that takes far longer than all tests
without a fault hangs, and is ended.
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
    "braking": ("joint_limits_exact", "motion_math"),
    "certificate": ("certificate_exact", "shapes_certificates", "verdicts"),
    "clearance": (
        "clearance_exact",
        "pair_groups_exact",
        "gate_exact",
        "verdicts",
        "retreat",
        "gate_order",
        "resets",
    ),
    "command_checks": ("gate_order", "gate_exact"),
    "decision": ("decision_exact", "gate_order", "retreat", "verdicts"),
    "engines": ("certificate_exact", "shapes_certificates"),
    "gate": ("gate_order", "gate_exact", "gate_reserved", "faults", "resets"),
    "joint_limits": ("joint_limits_exact", "motion_math"),
    "motion_bounds_range": ("motion_bounds_range", "resets"),
    "nearest_pairs": ("nearest_exact", "gate_exact", "resets"),
    "occupancy": ("occupancy_exact", "motion_math", "tracking_lag"),
    "pair_bounds": ("pair_bounds", "gate_exact"),
    "pair_check": ("clearance_exact", "pair_groups_exact", "verdicts"),
    "pair_groups": ("pair_groups_exact", "prefilter", "resets"),
    "penetration": ("penetration",),
    "prefilter": ("prefilter", "clearance_exact", "gate_exact"),
    "reservations": ("gate_reserved", "gate_exact", "gate_order", "resets"),
    "retreat": ("retreat", "gate_exact", "resets"),
    "robot": ("robot_exact", "gate_exact", "retreat", "faults", "gate_order", "motion_bounds_range"),
    "standstill": ("standstill", "robot_exact"),
    "step_bounds": ("verdict_wording", "joint_limits_exact", "robot_exact", "verdicts"),
    "stops": ("stops", "gate_exact", "gate_order"),
    "support": ("pair_groups_exact", "shapes_certificates"),
    "swept": ("pair_groups_exact", "prefilter", "motion_bounds_range", "resets"),
    "tick_checks": ("tick_checks", "gate_exact"),
    "tracking_lag": ("tracking_lag", "decision_exact"),
    "verdict_wording": ("verdict_wording", "verdicts", "joint_limits_exact", "decision_exact"),
}
"""Test modules about a module of the gate: the likeliest to notice a fault in it."""

_WITHOUT = [f"-pno:{name}" for name in ("cacheprovider", "unraisableexception", "threadexception")]
"""Plugins that take a third of a second in each process and are not needed."""

_POLL = 0.02


class Mutated(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Importer of one module from a syntax tree."""

    def __init__(self, name: str, path: Path, tree: ast.Module) -> None:
        self._name, self._path, self._tree = name, path, tree

    def find_spec(self, fullname: str, path: object, target: object = None) -> Any:
        """Return the specification of the mutated module, None for all others."""
        if fullname != self._name:
            return None
        return importlib.machinery.ModuleSpec(fullname, self, origin=str(self._path))

    def exec_module(self, module: types.ModuleType) -> None:
        """Execute the syntax tree."""
        exec(compile(self._tree, str(self._path), "exec"), module.__dict__)  # noqa: S102


class Order:
    """pytest plugin that runs the quickest tests first and keeps their durations.

    Tests that take longer than ``longest`` are left out.
    """

    def __init__(self, known: dict[str, float], longest: float = math.inf) -> None:
        self.known, self.longest, self.seen = known, longest, dict[str, float]()

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Sort the tests by their known duration."""
        items[:] = [item for item in items if self.known.get(item.nodeid, 0.0) <= self.longest]
        items.sort(key=lambda item: self.known.get(item.nodeid, 0.0))

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Add the duration of a test."""
        self.seen[report.nodeid] = self.seen.get(report.nodeid, 0.0) + report.duration


def preload() -> None:
    """Import once the modules that every fork needs and no mutant changes."""
    import coal  # noqa: F401, PLC0415
    import fcl  # noqa: F401, PLC0415
    import hypothesis  # noqa: PLC0415
    import hypothesis.stateful  # noqa: PLC0415

    sys.path[:0] = [str(Path("tests").absolute()), str(Path.cwd())]
    import_module("gate.oracle")
    import_module("gate.scenes").mesh()  # caches the mesh's parts
    os.environ.update(PYTEST_DISABLE_PLUGIN_AUTOLOAD="1", ARMGATE_NUMPY="1")
    phases = (hypothesis.Phase.explicit, hypothesis.Phase.generate)  # no shrinking
    hypothesis.settings.register_profile(
        "mutants", derandomize=True, database=None, deadline=None, phases=phases
    )
    hypothesis.settings.load_profile("mutants")


def times(tests: Sequence[str]) -> dict[str, float]:
    """Return the duration of each test without a fault, s.

    Raises:
        RuntimeError: A test fails without a fault, so that no mutant can be assessed.
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


def run_tests(finder: Mutated, stages: Sequence[Sequence[str]], order: Order, most: float) -> str:
    """Run tests against a mutant and return ``killed``, ``hangs`` or ``survived``.

    Args:
        finder: The mutant.
        stages: Test files and folders, run one stage after the other.
        order: Durations of the tests, for their order, and the longest duration.
        most: Seconds after which the mutant counts as hanging.
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


def tests_about(module: str) -> list[str]:
    """Return the test files about a module of the gate."""
    files = [Path("tests/gate") / f"test_{name}.py" for name in ABOUT.get(module, ())]
    return [str(file) for file in files if file.exists()]
