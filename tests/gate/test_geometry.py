"""Support functions, slabs, certificates, nearest pairs and motion bounds against samples and the oracle."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armgate.cell.shapes import Box, Capsule, Cylinder, Sphere
from armgate.gate.clearance import Clearance
from armgate.gate.clearance.certificate import Budget
from armgate.gate.clearance.nearest_pairs import NearestPairs, start_clearances
from armgate.gate.clearance.pair_groups import ChainGroup
from armgate.gate.clearance.support import support, support_table
from armgate.gate.occupancy import occupancy
from gate import scenes
from gate.oracle import Oracle
from gate.solids import Solid

SHAPES = [Sphere(0.1), Capsule(0.05, 0.3), Cylinder(0.1, 0.2), Box(0.1, 0.2, 0.4)]
CELLS = {name: make() for name, make in scenes.SCENES.items() if name != "demo"}


@pytest.mark.parametrize("shape", SHAPES, ids=lambda s: s.kind)
def test_a_support_function_is_the_reach_of_the_body(shape):
    rng = np.random.default_rng(0)
    solid = Solid("x", shape.kind, shape.size)
    points = rng.uniform(-0.4, 0.4, (40000, 3))
    points = points[[solid.holds(x, 0.0) for x in points]]
    rows = support_table([shape])
    for v in rng.normal(size=(50, 3)):
        n = v / np.linalg.norm(v)
        h = float(support(rows, n[None, :])[0])
        assert h == pytest.approx(solid.reach(n), abs=1e-12)
        assert (points @ n).max() <= h + 1e-12
        assert (points @ n).max() >= h - 0.05


def random_occupancies(cell, rng, reach=0.25):
    out = []
    for r in cell.robots:
        a = rng.uniform(r.lower, r.upper)
        b, c = (np.clip(a + rng.uniform(-reach, reach, r.model.n), r.lower, r.upper) for _ in range(2))
        past = [np.clip(a + rng.uniform(-0.05, 0.05, r.model.n), r.lower, r.upper) for _ in range(2)]
        past = [tuple(map(float, p)) for p in past]
        a, b, c = (tuple(map(float, x)) for x in (a, b, c))
        out.append((occupancy(a, b, c, past, 1e-3), np.array([a, b, c, *past])))
    return out


@pytest.mark.parametrize("name", sorted(CELLS))
def test_the_slab_is_below_the_distance_for_every_timing(name):
    """For any direction and any two positions in both hulls, the distance is at least the slab's bound."""
    cell, rng = CELLS[name], np.random.default_rng(1)
    clearance, oracle = Clearance(cell), Oracle(cell)
    for _ in range(12):
        covered = random_occupancies(cell, rng)
        swept = [clearance.space.sweep(i, o) for i, (o, _) in enumerate(covered)]
        qs = [rng.dirichlet(np.ones(len(x)) * 0.5, 60) @ x for _, x in covered]
        R, t = oracle.place(qs)
        for i in range(len(cell.robots)):
            for group in clearance.groups[i]:
                side = clearance.space.static if group.other is None else swept[group.other]
                for k, pair in enumerate(group.ids):
                    close = oracle.below(R, t)[:, pair].argmin() if k % 7 == 0 else rng.integers(60)
                    apart = oracle.apart(int(pair), R[close], t[close])
                    n = apart.normal * group.sign[k]
                    if isinstance(group, ChainGroup):
                        n = swept[i].pose(0, int(group.mine[k]))[0].T @ n
                    lb, _, _ = group.slab(swept[i], side, np.array([k]), n[None, :])
                    assert lb[0] <= apart.high + 1e-6


@pytest.mark.daily(3)
@pytest.mark.parametrize("name", sorted(CELLS))
def test_pairs_that_are_proven_clear_are_clear(name):
    """All four stages together: without a binding pair no sampled timing is closer than needed."""
    cell, rng = CELLS[name], np.random.default_rng(2)
    oracle, cleared = Oracle(cell), 0
    for _ in range(25):
        clearance = Clearance(cell)
        covered = random_occupancies(cell, rng, 0.12)
        swept = [clearance.space.sweep(i, o) for i, (o, _) in enumerate(covered)]
        for i, s in enumerate(swept):
            clearance.hold(i, [s])
        for i in range(len(swept)):
            clearance.prove_all(i)
        qs = [rng.dirichlet(np.ones(len(x)) * 0.5, 80) @ x for _, x in covered]
        R, t = oracle.place(qs)
        low = oracle.below(R, t)
        for i in range(len(swept)):
            checked = clearance.check(i, swept[i], None, clearance.limits_of[i], Budget(32))
            for place, pair in enumerate(clearance.pairs_of[i]):
                at = int(low[:, pair].argmin())
                if low[at, pair] < max(checked.lb[place], clearance.bound[pair]):
                    high = oracle.apart(int(pair), R[at], t[at]).high
                    assert max(checked.lb[place], clearance.bound[pair]) <= high + 1e-6
            cleared += checked.binding is None
    assert cleared > 0


@pytest.mark.daily(2)
@pytest.mark.parametrize("name", sorted(CELLS))
def test_growth_bounds_the_decrease_of_distance_by_a_step(name):
    cell, rng = CELLS[name], np.random.default_rng(3)
    clearance, oracle = Clearance(cell), Oracle(cell)
    for _ in range(30):
        qs = [rng.uniform(r.lower, r.upper) for r in cell.robots]
        for i, r in enumerate(cell.robots):
            step = rng.uniform(-0.1, 0.1, r.model.n)
            moved = [
                np.stack([q, np.clip(q + step, r.lower, r.upper) if k == i else q]) for k, q in enumerate(qs)
            ]
            R, t = oracle.place(moved)
            for group in clearance.groups[i]:
                for k, pair in enumerate(group.ids):
                    before, after = (oracle.apart(int(pair), R[m], t[m]) for m in (0, 1))
                    lost = before.low - after.high
                    assert lost <= float(group.growth[k] @ np.abs(step)) + 1e-5


@pytest.mark.daily(1)
@pytest.mark.parametrize("name", sorted(CELLS))
def test_the_nearest_pair_is_the_nearest_of_all(name):
    cell, rng = CELLS[name], np.random.default_rng(4)
    clearance, oracle = Clearance(cell), Oracle(cell)
    nearest = NearestPairs(clearance)
    names = [(cell.bodies[p.a].name, cell.bodies[p.b].name) for p in cell.pairs]
    q = [rng.uniform(r.lower, r.upper) for r in cell.robots]
    for tick in range(60):
        step = [rng.uniform(-1.0, 1.0, r.model.n) * r.velocity * r.period for r in cell.robots]
        q = [np.clip(x + u, r.lower, r.upper) for x, u, r in zip(q, step, cell.robots, strict=True)]
        R, t = oracle.place([x[None, :] for x in q])
        for i in range(len(q)):
            found = nearest.find(i, [tuple(map(float, x)) for x in q], 3)
            reported = next(iter(found.values()))
            apart = {int(p): oracle.apart(int(p), R[0], t[0]) for p in clearance.pairs_of[i]}
            if min(a.high for a in apart.values()) <= 0:
                continue  # in penetration neither value is exact
            best = min(apart, key=lambda p: apart[p].high - cell.pairs[p].limit)
            margin = apart[best].high - cell.pairs[best].limit
            assert reported.distance - reported.limit <= margin + 1e-6
            if tick >= 1:
                assert reported.distance - reported.limit >= margin - 1e-3
            for near in found.values():
                assert near.distance <= apart[names.index(near.pair)].high + 1e-6


def test_the_start_clearances_are_in_order_and_at_most_the_true_distances():
    cell = scenes.duel()
    oracle, found = Oracle(cell), start_clearances(cell)
    R, t = oracle.place([r.start[None, :] for r in cell.robots])
    margins = [n.distance - n.limit for n in found]
    names = [(cell.bodies[p.a].name, cell.bodies[p.b].name) for p in cell.pairs]
    assert margins == sorted(margins)
    for near in found:
        assert near.distance <= oracle.apart(names.index(near.pair), R[0], t[0]).high + 1e-6


@pytest.mark.slow
@settings(max_examples=200, deadline=None)
@given(st.integers(0, 10**6))
def test_every_proof_is_below_the_true_distance(seed):
    """For random pairs of spheres, capsules, cylinders and boxes, no bound exceeds the oracle's distance."""
    rng = np.random.default_rng(seed)
    bodies = [scenes.body(s.kind, *s.size) for s in (SHAPES[rng.integers(4)], SHAPES[rng.integers(4)])]
    start = [float(x) for x in rng.uniform(-0.3, 0.3, 2)]
    rpy = [float(x) for x in rng.uniform(-3, 3, 3)]
    b = bodies[1]
    size = b["size"][0] if b["kind"] == "sphere" else list(b["size"])
    robot = {"urdf": scenes.cart((1, 0, 0), (0, 1, 0), shape=bodies[0]), "start": start}
    cell = scenes.build(
        {"A": robot}, surroundings={"x": {"shape": {b["kind"]: size}, "xyz": [0, 0, 0], "rpy": rpy}}
    )
    clearance, oracle = Clearance(cell), Oracle(cell)
    R, t = oracle.place([np.array([start])])
    bound = clearance.point_bound(0, 0, tuple(start))
    apart = oracle.apart(0, R[0], t[0])
    # If bodies overlap, the oracle returns its best plane, which may be up to 1 mm below the true distance.
    assert bound <= apart.high + (1e-7 if apart.high > 0.0 else 1e-3)
    if apart.high > 1e-3:
        assert bound >= apart.high - 1e-4
