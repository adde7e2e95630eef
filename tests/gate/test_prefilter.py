"""The compiled prefilter against the numpy prefilter and the slabs of the groups, over random states."""

import os
import subprocess
import sys

import numpy as np
import pytest

from armgate.gate.clearance import Clearance
from armgate.gate.clearance.compiled import CompiledPrefilter
from armgate.gate.clearance.prefilter import MARGIN, Prefilter, robot_pairs
from armgate.gate.occupancy import Occupancy, occupancy
from gate import scenes

NUMPY_ONLY = bool(os.environ.get("ARMGATE_NUMPY"))  # see conftest.py
FORMS = [False] if NUMPY_ONLY else [False, True]
CELLS = {name: make() for name, make in scenes.SCENES.items()}
TOLERANCE = 1e-12
"""Tolerance for sums in another order, m; each bound is lowered by a thousand times this."""


def random_occupancy(robot, rng, nodes=3):
    points = [rng.uniform(robot.lower, robot.upper)]
    points += [np.clip(points[0] + rng.uniform(-0.2, 0.2, robot.model.n), robot.lower, robot.upper)
               for _ in range(nodes - 1)]  # fmt: skip
    points = [tuple(map(float, p)) for p in points]
    if nodes < 3:
        return Occupancy(tuple(points), (1e-3,) * robot.model.n)
    return occupancy(*points, [points[1]], 1e-3)


def held(clearance, occupied):
    for i, kept in enumerate(occupied):
        clearance.hold(i, [clearance.space.sweep(i, o) for o in kept])


def states(cell, count, seed=0):
    """Yield held occupancies of all robots, an occupancy to check, a step, kept bounds and directions."""
    rng = np.random.default_rng(seed)
    for k in range(count):
        occupied = [
            [random_occupancy(r, rng, int(rng.integers(1, 4))) for _ in range(rng.integers(1, 5))]
            for r in cell.robots
        ]
        robot = k % len(cell.robots)
        bound = rng.uniform(-0.2, 1.0, len(cell.pairs))
        n = rng.normal(size=(len(cell.pairs), 3))
        n /= np.linalg.norm(n, axis=1, keepdims=True)
        step = None if k % 5 == 0 else np.abs(rng.normal(0.0, 0.1, cell.robots[robot].model.n))
        yield occupied, robot, random_occupancy(cell.robots[robot], rng), step, (bound, n)


@pytest.mark.parametrize("name", sorted(CELLS))
@pytest.mark.parametrize("compiled", FORMS)
def test_bounds_equal_those_of_the_groups(name, compiled):
    """Kept bound or slab, pair by pair, by the formulas of the groups."""
    cell = CELLS[name]
    clearance = Clearance(cell, compiled)
    assert type(clearance.prefilter) is (CompiledPrefilter if compiled else Prefilter)
    tried = untouched = 0
    for occupied, robot, one, step, kept in states(cell, 12):
        held(clearance, occupied)
        new, (bound, n) = clearance.space.sweep(robot, one), kept
        ids, need = clearance.pairs_of[robot], clearance.limits_of[robot]
        lb, left = clearance.prefilter.run(robot, new, step, need, (bound[ids], n))
        lowered, proven = [], []
        for group in clearance.groups[robot]:
            lowered.append(np.full(len(group.ids), -np.inf))
            if step is not None:
                lowered[-1] = bound[group.ids] - group.growth @ step
            every = np.arange(len(group.ids))
            sides = [clearance.space.static]
            if group.other is not None:
                sides = [new] if group.other == robot else clearance.held[group.other]
            slabs = [group.slab(new, s, every, n[group.ids] * group.sign[:, None])[0] for s in sides]
            proven.append(np.maximum(lowered[-1], np.min(slabs, axis=0) - MARGIN))
        lowered, proven = np.concatenate(lowered), np.concatenate(proven)
        must = lowered < need
        np.testing.assert_allclose(lb[must], proven[must], rtol=0.0, atol=TOLERANCE)
        untried = np.abs(lb - lowered) <= TOLERANCE
        np.testing.assert_allclose(lb[~untried], proven[~untried], rtol=0.0, atol=TOLERANCE)
        assert list(left) == [k for k in range(len(ids)) if lb[k] < need[k]]
        tried += int(must.sum())
        untouched += int(untried.sum())
    assert untouched > 20
    assert tried > 20


@pytest.mark.parametrize("compiled", FORMS)
def test_a_robot_of_unknown_position_leaves_its_pairs_open(compiled):
    cell = CELLS["demo"]
    clearance = Clearance(cell, compiled)
    robot = cell.robots[0]
    new = clearance.space.still(0, tuple(map(float, robot.start)))
    clearance.hold(0, [new])
    none = np.full(len(clearance.pairs_of[0]), -np.inf)
    lb, left = clearance.prefilter.run(0, new, None, clearance.limits_of[0], (none, clearance._n))
    open_ = set(clearance.pairs_of[0][left].tolist())
    with_other = [p for g in clearance.groups[0] if g.other == 1 for p in g.ids]
    assert with_other
    assert open_.issuperset(with_other)
    assert np.all(np.isneginf(lb[np.isin(clearance.pairs_of[0], with_other)]))


@pytest.mark.parametrize("name", sorted(CELLS))
@pytest.mark.parametrize("compiled", FORMS)
@pytest.mark.parametrize("what", ["tube", "first node", "middle node", "last node", "kept bound"])
def test_a_bound_that_is_not_a_number_leaves_its_pair_open(what, compiled, name):
    """NaN proves nothing, for any distance needed."""
    clearance = Clearance(CELLS[name], compiled)
    for occupied, robot, one, _, (_, n) in states(CELLS[name], 4, seed=3):
        held(clearance, occupied)
        ids, new = clearance.pairs_of[robot], clearance.space.sweep(robot, one)
        nodes, tube, step, bound = new.nodes.copy(), new.tube, None, np.ones(len(ids))
        match what:
            case "tube":
                tube = np.full_like(tube, np.nan)
            case "kept bound":
                bound, step = np.full_like(bound, np.nan), np.zeros_like(tube)
            case _:
                nodes[{"first node": 0, "middle node": 1, "last node": -1}[what]] = np.nan
        new = clearance.space.sweep_nodes(robot, nodes, tube)
        _, left = clearance.prefilter.run(robot, new, step, np.full(len(ids), -1e300), (bound, n))
        assert len(left) == len(ids)


@pytest.mark.skipif(NUMPY_ONLY, reason="compares with the compiled form")
@pytest.mark.parametrize("name", sorted(CELLS))
def test_compiled_placements_equal_those_of_pinocchio(name):
    cell, rng = CELLS[name], np.random.default_rng(1)
    readable, compiled = Clearance(cell, False).space, Clearance(cell, True).space
    for i, robot in enumerate(cell.robots):
        for _ in range(20):
            q = rng.uniform(robot.lower, robot.upper)[None, :]
            one, other = (s.sweep_nodes(i, q, np.zeros(robot.model.n)) for s in (readable, compiled))
            np.testing.assert_allclose(other.R, one.R, rtol=0.0, atol=TOLERANCE)
            np.testing.assert_allclose(other.t, one.t, rtol=0.0, atol=TOLERANCE)


@pytest.mark.skipif(NUMPY_ONLY, reason="compares with the compiled form")
def test_no_tick_compiles_anything():
    """Arguments of another type would start the compiler: they are an error instead."""
    clearance = Clearance(CELLS["demo"], True)
    new = clearance.space.still(0, tuple(map(float, CELLS["demo"].robots[0].start)))
    new = clearance.space.sweep_nodes(0, new.nodes, new.tube.astype(np.float32))
    with pytest.raises(TypeError, match="No matching definition"):
        clearance.prefilter.run(0, new, None, clearance.limits_of[0], (clearance.bound.of(0), clearance._n))


def test_without_numba_the_gate_uses_numpy():
    code = (
        "import sys; sys.modules['numba'] = None\n"
        "from armgate.cell.compilation import available\n"
        "from armgate.gate.clearance import Clearance\n"
        "from gate import scenes\n"
        "print(available(), type(Clearance(scenes.lane()).prefilter).__name__)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, cwd="tests"
    )
    assert done.stdout.split() == ["False", "Prefilter"], done.stderr


@pytest.mark.parametrize("compiled", FORMS)
def test_a_pair_that_will_be_open_within_eight_steps_is_tried_with_an_open_pair_of_its_side(compiled):
    """If no pair is open, no pair is tried."""
    cell = CELLS["duel"]
    clearance = Clearance(cell, compiled)
    for i, r in enumerate(cell.robots):
        clearance.hold(i, [clearance.space.still(i, tuple(map(float, r.start)))])
    own, need = clearance.prefilter.pairs[0], clearance.limits_of[0]
    new, step = clearance.held[0][0], np.full(cell.robots[0].model.n, 1e-3)
    loss = own.growth @ step
    tried = []
    slabs = clearance.prefilter._slabs

    def watched(robot, new, left, n):
        tried.append(left.tolist())
        return slabs(robot, new, left, n)

    clearance.prefilter._slabs = watched
    open_, soon, later, elsewhere = 0, 1, 2, int(np.flatnonzero(own.side != own.side[0])[0])
    assert own.side[later] == own.side[open_]
    bound = need + 20.0 * loss + 1e-6
    for k, steps in ((soon, 8.9), (later, 9.1), (elsewhere, 5.0)):
        bound[k] = need[k] + steps * loss[k]
    lb, left = clearance.prefilter.run(0, new, step, need, (bound, clearance._n))
    assert tried == []
    assert len(left) == 0
    np.testing.assert_allclose(lb, bound - loss, rtol=0.0, atol=TOLERANCE)
    bound[open_] = need[open_]
    clearance.prefilter.run(0, new, step, need, (bound, clearance._n))
    assert tried == [[open_, soon]]


def test_a_robot_without_pairs_has_nothing_to_check():
    none = robot_pairs([], 3)
    assert [len(x) for x in (none.ids, none.mine, none.theirs, none.sign, none.side)] == [0] * 5
    assert none.growth.shape == (0, 3)
    assert (none.chain, none.chained) == (None, 0)


@pytest.mark.parametrize("compiled", FORMS)
def test_a_slab_equal_to_the_distance_needed_leaves_no_pair_open(compiled):
    cell = CELLS["duel"]
    clearance = Clearance(cell, compiled)
    starts = [tuple(map(float, r.start)) for r in cell.robots]
    for i, q in enumerate(starts):
        clearance.hold(i, [clearance.space.still(i, q)])
    clearance.prove_all(0)
    new, n = clearance.space.still(0, starts[0]), clearance._n
    count = len(clearance.pairs_of[0])
    lb, left = clearance.prefilter.run(0, new, None, np.full(count, np.inf), (np.zeros(count), n))
    assert len(left) == count
    again, left = clearance.prefilter.run(0, new, None, lb, (np.zeros(count), n))
    assert np.array_equal(again, lb)
    assert len(left) == 0


@pytest.mark.parametrize("compiled", FORMS)
def test_a_kept_bound_equal_to_the_distance_needed_is_not_tried_again(compiled):
    """Two balls 2 m apart: 1.25 m were proven, a step takes 0.25 m, and 1 m must be kept."""
    clearance = Clearance(scenes.head_on(2.1), compiled)
    for i, x in enumerate((-1.05, 1.05)):
        clearance.hold(i, [clearance.space.still(i, (x,))])
    clearance.prove_all(0)
    new, step, kept = clearance.held[0][0], np.array([0.25]), (np.array([1.25]), clearance._n)
    lb, left = clearance.prefilter.run(0, new, step, np.array([1.0]), kept)
    assert (lb.tolist(), left.tolist()) == ([1.0], [])
    lb, left = clearance.prefilter.run(0, new, step, np.array([1.001]), kept)
    assert (lb[0], left.tolist()) == (pytest.approx(2.0, abs=1e-8), [])


@pytest.mark.parametrize("compiled", FORMS)
def test_an_occupancy_that_was_checked_but_not_held_does_not_count_for_other_robots(compiled):
    """The left robot is checked for a path to the right; the right robot uses its held position."""
    clearance = Clearance(scenes.head_on(1.1), compiled)
    for i, x in enumerate((-0.55, 0.55)):
        clearance.hold(i, [clearance.space.still(i, (x,))])
    clearance.prove_all(0)
    need, step, kept = np.array([0.9]), None, (np.array([1.0]), clearance._n)
    for _ in range(2):
        new = clearance.space.sweep(0, Occupancy(((-0.55,), (0.0,)), (0.0,)))
        assert clearance.prefilter.run(0, new, step, need, kept)[0] == pytest.approx([0.45], abs=1e-8)
        still = clearance.space.still(1, (0.55,))
        assert clearance.prefilter.run(1, still, step, need, kept)[0] == pytest.approx([1.0], abs=1e-8)
    clearance.hold(0, [clearance.space.still(0, (-0.25,))])
    assert clearance.prefilter.run(1, still, step, need, kept)[0] == pytest.approx([0.7], abs=1e-8)
