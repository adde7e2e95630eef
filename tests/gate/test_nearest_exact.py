"""Nearest pairs of the state, against engine queries for all pairs."""

import os
import pickle

import numpy as np
import pytest

from armgate.gate.clearance import Clearance
from armgate.gate.clearance.compiled_nearest import CompiledNearestPairs, nearest_pairs_of
from armgate.gate.clearance.engines import CoalEngine
from armgate.gate.clearance.nearest_pairs import NearestPairs, first, start_clearances
from gate import scenes
from gate.oracle import Oracle

NUMPY_ONLY = bool(os.environ.get("ARMGATE_NUMPY"))  # see conftest.py
FORMS = [False] if NUMPY_ONLY else [False, True]
TOLERANCE = 1e-9
"""Tolerance for distances, m: coal ends its iterations within 1e-8, at other steps for poses that differ."""


@pytest.mark.parametrize("name", ["duel", "tree", "mesh"])
@pytest.mark.parametrize("count", [1, 3, 6])
@pytest.mark.parametrize("compiled", FORMS)
def test_the_lowest_bounds_are_reported_and_the_nearest_pairs_have_true_distances(name, count, compiled):
    """In small steps and in leaps: the nearest pair of all, and the nearest pair with another body."""
    cell, rng = scenes.SCENES[name](), np.random.default_rng(count)
    oracle = Oracle(cell)
    nearest = nearest_pairs_of(Clearance(cell, compiled))
    q = [np.array(r.start, dtype=float) for r in cell.robots]
    for k in range(40):
        reach = 0.8 if k % 9 == 8 else 0.02
        q = [np.clip(x + rng.uniform(-reach, reach, len(x)), r.lower, r.upper)
             for x, r in zip(q, cell.robots, strict=True)]  # fmt: skip
        R, t = oracle.place([x[None, :] for x in q])
        for i in range(len(q)):
            found = nearest.find(i, [tuple(map(float, x)) for x in q], count)
            mine = [int(p) for p in nearest._clearance.pairs_of[i]]
            true = {p: oracle.apart(p, R[0], t[0]) for p in mine}
            if min(a.high for a in true.values()) <= 0.0:
                continue
            margin = {p: n.distance - n.limit for p, n in found.items()}
            assert list(margin.values())[:count] == sorted(margin.values())[:count]
            assert count <= len(found) <= count + 1
            for p, n in found.items():
                assert n.distance <= true[p].high + 1e-6
                assert n.limit == cell.pairs[p].limit
                assert set(n.pair) == {cell.bodies[x].name for x in (cell.pairs[p].a, cell.pairs[p].b)}
            for group in (mine, [p for p in mine if cell.pairs[p].kind != "self"]):
                least = min(true[p].high - cell.pairs[p].limit for p in group)
                reported = min(margin[p] for p in group if p in margin)
                assert least - 1e-5 <= reported <= least + 1e-6
                (at,) = [p for p in group if margin.get(p) == reported][:1]
                a, b = (np.array(x) for x in found[at].points)
                assert np.linalg.norm(a - b) == pytest.approx(found[at].distance, abs=1e-5)


def test_a_robot_of_unknown_position_has_no_distance():
    cell = scenes.head_on(1.1)
    nearest = NearestPairs(Clearance(cell, False))
    assert nearest.find(0, [(-0.55,), None], 3) == {}
    assert nearest.find(1, [(-0.55,), None], 3) == {}
    (found,) = nearest.find(0, [(-0.55,), (0.55,)], 3).values()
    assert found.distance == pytest.approx(1.0, abs=1e-6)
    (found,) = nearest.find(1, [(-0.5,), (0.55,)], 3).values()
    assert found.distance == pytest.approx(0.95, abs=1e-6)


def test_a_robot_that_stands_still_is_placed_once():
    cell = scenes.head_on(1.1)
    clearance = Clearance(cell, False)
    nearest = NearestPairs(clearance)
    q = [(-0.55,), (0.55,)]
    nearest.find(0, q, 1)
    queries = clearance.certifier.queries
    assert queries == 1
    nearest.find(0, q, 1)
    assert clearance.certifier.queries <= queries + 1


@pytest.mark.parametrize("compiled", FORMS)
def test_witness_points_measure_a_pair_without_a_query_until_they_are_loose(compiled):
    """Along the line between two balls the points stay the nearest ones; across it they do not."""
    cell = scenes.build({"A": {"urdf": scenes.cart((1, 0, 0), (0, 1, 0)), "start": [0.0, 0.0]}},
                        surroundings={"b": {"shape": {"sphere": 0.1}, "xyz": [1.0, 0, 0]}})  # fmt: skip
    clearance = Clearance(cell, compiled)
    nearest, certifier = nearest_pairs_of(clearance), clearance.certifier
    (first_found,) = nearest.find(0, [(0.0, 0.0)], 1).values()
    queries = certifier.queries
    assert queries > 0
    (along,) = nearest.find(0, [(0.2, 0.0)], 1).values()
    assert certifier.queries == queries
    assert along.distance == pytest.approx(first_found.distance - 0.2, abs=1e-8)
    assert along.points == (pytest.approx(np.add(first_found.points[0], (0.2, 0, 0)), abs=1e-6),
                            pytest.approx(first_found.points[1], abs=1e-6))  # fmt: skip
    (across,) = nearest.find(0, [(0.2, 0.3)], 1).values()
    assert certifier.queries == queries + 1
    (fresh,) = nearest_pairs_of(Clearance(cell, compiled)).find(0, [(0.2, 0.3)], 1).values()
    assert across.distance == pytest.approx(fresh.distance, abs=1e-8)


def test_the_lowest_few_are_in_order_and_equal_values_in_the_order_of_their_places():
    margin = np.array([0.5, 0.1, 0.3, 0.1, np.inf, -0.2])
    for count, expected in ((1, [5]), (3, [5, 1, 3]), (4, [5, 1, 3, 2]), (9, [5, 1, 3, 2, 0, 4])):
        assert first(margin, count).tolist() == expected
    assert first(np.zeros(0), 3).tolist() == []
    rng = np.random.default_rng(3)
    for size in (1, 2, 3, 20, 500):
        margin = rng.permutation(size).astype(float)
        for count in (*range(1, min(size, 30)), size, size + 1):
            assert margin[first(margin, count)].tolist() == list(range(min(count, size)))


def test_found_directions_are_kept_for_later_checks():
    clearance = Clearance(scenes.lane(), False)
    NearestPairs(clearance).find(0, [(0.0, 1.5)], 1)
    assert clearance._n == pytest.approx(np.array([[1.0, 0.0, 0.0]]), abs=1e-4)


def test_distances_to_static_bodies_are_reported_though_a_robot_is_unknown():
    cell = scenes.head_on(1.1, surroundings={"b": {"shape": {"sphere": 0.1}, "xyz": [-0.55, 0.5, 0]}})
    (found,) = NearestPairs(Clearance(cell, False)).find(0, [(-0.55,), None], 3).values()
    assert found.pair[1] == "b"
    assert found.distance == pytest.approx(0.35, abs=1e-6)


def test_a_leap_among_many_bodies_costs_few_queries():
    """All kept bounds are used up at once: slabs of all pairs select the few pairs to query."""
    rng = np.random.default_rng(5)
    around = {
        f"b{k}": {"shape": {"box": [0.02, 0.03, 0.04]}, "xyz": [float(x) for x in rng.uniform(-2, 2, 3)]}
        for k in range(60)
    }
    robot = {"urdf": scenes.cart((1, 0, 0), (0, 1, 0), (0, 0, 1)), "start": [0.0] * 3}
    cell = scenes.build({"A": robot}, surroundings=around)
    clearance, oracle = Clearance(cell, False), Oracle(cell)
    clearance.hold(0, [clearance.space.still(0, (0.0,) * 3)])
    clearance.prove_all(0)
    nearest, most = NearestPairs(clearance), 0
    for _ in range(20):
        q = tuple(map(float, rng.uniform(-0.25, 0.25, 3)))
        before = clearance.certifier.queries
        found = next(iter(nearest.find(0, [q], 1).values()))
        most = max(most, clearance.certifier.queries - before)
        R, t = oracle.place([np.array([q])])
        true = min(oracle.apart(p, R[0], t[0]).high for p in range(len(cell.pairs)))
        assert found.distance == pytest.approx(true, abs=1e-5)
    assert most <= 8


@pytest.mark.parametrize("name", ["duel", "mesh"])
def test_start_clearances_contain_every_nearest_pair(name):
    cell = scenes.SCENES[name]()
    oracle = Oracle(cell)
    R, t = oracle.place([np.array([r.start]) for r in cell.robots])
    reported = start_clearances(cell)
    margins = [n.distance - n.limit for n in reported]
    assert margins == sorted(margins)
    true = {p: oracle.apart(p, R[0], t[0]).high - cell.pairs[p].limit for p in range(len(cell.pairs))}
    assert margins[0] == pytest.approx(min(true.values()), abs=1e-5)
    assert len(reported) > 10
    at = {frozenset(cell.bodies[x].name for x in (p.a, p.b)): k for k, p in enumerate(cell.pairs)}
    assert all(true[at[frozenset(n.pair)]] - m < 0.2 for n, m in zip(reported, margins, strict=True))


def around(*gaps):
    """Return a cell with one ball at the origin and balls around it at these distances."""
    angles = np.linspace(0.0, 2.0 * np.pi, len(gaps), endpoint=False)
    places = [
        ((0.15 + gap) * np.cos(a), (0.15 + gap) * np.sin(a), 0.0) for gap, a in zip(gaps, angles, strict=True)
    ]
    balls = {f"b{k}": {"shape": {"sphere": 0.1}, "xyz": [float(x) for x in p]} for k, p in enumerate(places)}
    robot = {"urdf": scenes.cart((1, 0, 0)), "start": [0.0]}
    return scenes.build({"A": robot}, surroundings=balls)


@pytest.mark.parametrize(
    ("gaps", "count", "reported"),
    [
        ((0.5, 0.3, 0.4, 0.2), 1, [0.2]),
        ((0.5, 0.3, 0.4, 0.2), 2, [0.2, 0.3]),
        ((0.5, 0.3, 0.4, 0.2), 3, [0.2, 0.3, 0.4]),
        ((0.5, 0.3, 0.4, 0.2), 9, [0.2, 0.3, 0.4, 0.5]),
        ((0.5, 0.01, 0.005, 0.2), 1, [0.005, 0.01]),  # all are below their limits
        ((0.5, 0.01, 0.005, 0.2), 3, [0.005, 0.01, 0.2]),
    ],
)
def test_start_clearances_are_the_nearest_few_and_those_below_their_limits(gaps, count, reported):
    assert [n.distance for n in start_clearances(around(*gaps), count)] == pytest.approx(reported, abs=1e-6)


def test_start_clearances_are_sixteen_unless_another_number_is_given():
    assert len(start_clearances(around(*np.linspace(0.2, 0.6, 20)))) == 16


def test_a_robot_without_pairs_has_no_clearance():
    assert start_clearances(around()) == []


def test_bounds_are_found_anew_when_the_motion_bounds_have_changed():
    clearance = Clearance(scenes.lever(), False)
    inside, outside = (0.0, 0.3, 0.0), (0.0, 2.0, 0.0)
    moved, fresh = NearestPairs(clearance), NearestPairs(clearance)
    moved.find(0, [inside], 1)
    clearance.fit(0, [outside], 0.0)
    moved._follow(0, outside)
    fresh._follow(0, outside)
    assert moved._margin == pytest.approx(fresh._margin)


def at_start(cell, compiled):
    """Return a search of a form, after the pairs were proven at the start as by a gate."""
    clearance = Clearance(cell, compiled)
    for i, robot in enumerate(cell.robots):
        clearance.hold(i, [clearance.space.still(i, tuple(map(float, robot.start)))])
    for i in range(len(cell.robots)):
        clearance.prove_all(i)
    return nearest_pairs_of(clearance)


def walk(cell, seed, steps=60):
    """Yield the index of the robot to report, and positions of all robots: small steps, leaps, and rests."""
    rng = np.random.default_rng(seed)
    q = [np.array(r.start, dtype=float) for r in cell.robots]
    for k in range(steps):
        reach = 0.6 if k % 11 == 10 else 0.01
        mover = int(rng.integers(len(q)))
        robot = cell.robots[mover]
        q[mover] = np.clip(q[mover] + rng.uniform(-reach, reach, len(q[mover])), robot.lower, robot.upper)
        yield k % len(q), [None if k < 2 and i else tuple(map(float, x)) for i, x in enumerate(q)]


@pytest.mark.skipif(NUMPY_ONLY, reason="compares with the compiled form")
@pytest.mark.parametrize("name", sorted(scenes.SCENES))
def test_both_forms_report_the_same_pairs_distances_and_directions(name):
    cell = scenes.SCENES[name]()
    forms = [at_start(cell, compiled) for compiled in (False, True)]
    assert [type(form) for form in forms] == [NearestPairs, CompiledNearestPairs]
    for robot, q in walk(cell, 7):
        readable, compiled = (form.find(robot, q, 3) for form in forms)
        assert list(readable) == list(compiled)
        for pair, one in readable.items():
            other = compiled[pair]
            assert (other.pair, other.limit) == (one.pair, one.limit)
            assert other.distance == pytest.approx(one.distance, abs=TOLERANCE)
            assert (other.points is None) == (one.points is None)
            assert type(other.distance) is type(other.limit) is float
    counts = [form._clearance.certifier.queries for form in forms]
    assert counts[0] == counts[1]


@pytest.mark.skipif(NUMPY_ONLY, reason="tests the compiled form")
@pytest.mark.parametrize("change", ["longer", "shorter", "another direction"])
def test_the_compiled_form_trusts_no_engine(change, monkeypatch):
    """A false suggestion is noticed by the bound of its direction, and the second engine is queried."""
    cell = scenes.SCENES["duel"]()
    honest = CoalEngine.query

    def wrong(self, *asked):
        distance, p, q, normal = honest(self, *asked)
        match change:
            case "longer":
                return distance + 0.01, p, q, normal
            case "shorter":
                return distance - 0.01, p, q, normal
            case _:
                return distance, p, q + np.array([0.0, 0.3, 0.2]), normal

    form, expected, oracle = at_start(cell, True), at_start(cell, False), Oracle(cell)
    for robot, q in walk(cell, 3, 20):
        if None in q:
            continue
        with monkeypatch.context() as patch:
            patch.setattr(CoalEngine, "query", wrong)
            found = form.find(robot, q, 3)
        R, t = oracle.place([np.array([x]) for x in q])
        for pair, one in found.items():
            assert one.distance <= oracle.apart(pair, R[0], t[0]).high + 1e-6
        lowest = next(iter(expected.find(robot, q, 3).values()))
        assert next(iter(found.values())).distance == pytest.approx(lowest.distance, abs=2e-3)
    assert form._clearance.certifier.gaps > 0


@pytest.mark.skipif(NUMPY_ONLY, reason="tests the compiled form")
def test_a_copy_of_the_compiled_form_continues_alike_and_shares_nothing():
    cell = scenes.SCENES["duel"]()
    form = at_start(cell, True)
    steps = list(walk(cell, 5))
    for robot, q in steps[:20]:
        form.find(robot, q, 3)
    copy = pickle.loads(pickle.dumps(form))
    again = [copy.find(robot, q, 3) for robot, q in steps[20:]]
    assert again == [form.find(robot, q, 3) for robot, q in steps[20:]]


@pytest.mark.skipif(NUMPY_ONLY, reason="tests the compiled form")
def test_constants_of_the_kernels_are_those_of_the_readable_form():
    from armgate.gate.clearance import certificate, engines, kernels

    assert kernels._GAP == certificate.GAP
    assert kernels._TIGHT == certificate.TIGHT
    assert kernels._TOUCHING == engines.TOUCHING
