"""Certificates and engines by hand: balls with known distances, anywhere in space."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from armgate.cell.shapes import Box, Cone, Convex, Sphere
from armgate.gate.clearance import certificate
from armgate.gate.clearance.certificate import GAP, Budget, Certifier
from armgate.gate.clearance.engines import CoalEngine, FclEngine, Suggestion, _thickened
from armgate.gate.clearance.pair_groups import Group
from armgate.gate.clearance.support import support_table
from armgate.gate.clearance.swept import Swept

ENGINES = [CoalEngine, FclEngine]
X = (1.0, 0.0, 0.0)
TIPS = tuple(tuple(0.5 * sign * x for x in axis) for axis in np.eye(3).tolist() for sign in (-1.0, 1.0))
"""Corners of a hull: for parallel faces FCL finds the distance for only half of the orders of the corners."""


class FixedEngine:
    """Engine with one answer that counts its queries."""

    def __init__(self, distance, normal=X, points=((0, 0, 0), (0, 0, 0))):
        self.answer = Suggestion(
            distance, np.array(normal, dtype=float), tuple(np.array(p, float) for p in points)
        )
        self.queries = 0

    def suggest(self, *_):
        self.queries += 1
        return self.answer


def balls(monkeypatch, first, second, *radii):
    """Return a certifier with these engines and a group of one pair, the first ball with the second."""
    monkeypatch.setattr(certificate, "CoalEngine", lambda shapes: first)
    monkeypatch.setattr(certificate, "FclEngine", lambda shapes: second)
    shapes = [Sphere(r) for r in radii]
    certifier = Certifier(SimpleNamespace(bodies=[SimpleNamespace(shape=s) for s in shapes]))
    rows, one, other = support_table(shapes), np.array([0]), np.array([1])
    group = Group(
        other=None, ids=one, mine=one, theirs=other, sign=np.ones(1), limit=np.zeros(1), shape_mine=one,
        shape_theirs=other, rows_mine=rows[one], rows_theirs=rows[other], growth=np.zeros((1, 0)),
    )  # fmt: skip
    return certifier, group


def standing(*nodes):
    """Return bodies at these positions, node by node."""
    t = np.array(nodes, dtype=float)
    none = np.zeros((t.shape[1], 0))
    R = np.broadcast_to(np.eye(3), (*t.shape[:2], 3, 3))
    return Swept(np.zeros((len(t), 0)), np.zeros(0), lambda: (R, t), none, none[:, :, None])


def test_a_budget_gives_as_many_evaluations_as_it_has():
    budget = Budget(2)
    assert [budget.take() for _ in range(4)] == [True, True, False, False]
    assert not Budget(0).take()


def test_a_bound_is_computed_for_the_requested_nodes(monkeypatch):
    certifier, group = balls(monkeypatch, FixedEngine(0.0), FixedEngine(0.0), 0.5, 0.25)
    mine = standing([(1, 2, 3), (0, 0, 0)], [(2, 2, 3), (0, 0, 0)], [(3, 2, 3), (0, 0, 0)])
    theirs = standing([(0, 0, 0), (9, 2, 3)], [(0, 0, 0), (8, 2, 3)], [(0, 0, 0), (6, 2, 3)])
    for i, j, centres in ((0, 0, 8.0), (0, 2, 5.0), (2, 0, 6.0), (1, 2, 4.0)):
        assert certifier.prove(group, 0, mine, theirs, (i, j)).lb == centres - 0.75


@pytest.mark.parametrize(("off", "second"), [(0.5, 0), (1.0, 0), (1.5, 1), (-0.5, 0), (-1.5, 1)])
def test_a_second_engine_is_queried_if_the_first_is_off_by_more_than_a_tenth_of_a_millimetre(
    off, second, monkeypatch
):
    """The balls touch, so that the proof is zero to the last bit."""
    engines = FixedEngine(off * 1e-4), FixedEngine(0.0)
    certifier, group = balls(monkeypatch, *engines, 0.5, 0.5)
    assert (certifier.queries, certifier.gaps) == (0, 0)
    sides = standing([(3, 1, 0), (0, 0, 0)]), standing([(0, 0, 0), (4, 1, 0)])
    for count in (1, 2):
        assert certifier.prove(group, 0, *sides, (0, 0)).lb == 0.0
        assert (certifier.queries, certifier.gaps) == (count, count * second)
    assert (engines[0].queries, engines[1].queries) == (2, 2 * second)


def test_a_correct_engine_is_used_at_any_distance(monkeypatch):
    first, second = FixedEngine(1.0), FixedEngine(0.0)
    certifier, group = balls(monkeypatch, first, second, 0.5, 0.5)
    proof = certifier.prove(group, 0, standing([(3, 1, 0)] * 2), standing([(5, 1, 0)] * 2), (0, 0))
    assert (proof.lb, certifier.gaps, second.queries) == (1.0, 0, 0)


@pytest.mark.parametrize(
    ("normals", "lb", "point"),
    [((X, X), 1.0, 1.0), (((0, 1, 0), X), 1.0, 2.0), ((X, (0, 1, 0)), 1.0, 1.0)],
)
def test_the_better_proof_counts_and_of_equal_proofs_the_first(normals, lb, point, monkeypatch):
    engines = [FixedEngine(5.0, n, [(k, 0, 0)] * 2) for k, n in enumerate(normals, 1)]
    certifier, group = balls(monkeypatch, *engines, 0.5, 0.5)
    proof = certifier.prove(group, 0, standing([(3, 1, 0)] * 2), standing([(5, 1, 0)] * 2), (0, 0))
    assert proof.lb == lb
    assert tuple(proof.n) == X
    assert proof.points == ((point, 0.0, 0.0), (point, 0.0, 0.0))


# --- bodies that overlap ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("centres", "lb"),
    [(0.75, -0.25), (1.0, -1.5), (2.0, 0.0), (3.0, 0.5)],
)
def test_only_overlapping_bodies_get_another_direction_than_that_of_the_engines(centres, lb, monkeypatch):
    """Balls of 0.5 m; the engines return a direction 60 degrees off the line of the centres."""
    n = (0.5, math.sqrt(0.75), 0.0) if lb != -1.5 else (-0.5, math.sqrt(0.75), 0.0)
    certifier, group = balls(monkeypatch, FixedEngine(lb, n), FixedEngine(lb, n), 0.5, 0.5)
    sides = standing([(1, 0, 0)] * 2), standing([(1 + centres, 0, 0)] * 2)
    proof = certifier.prove(group, 0, *sides, (0, 0))
    assert proof.lb == pytest.approx(centres - 1.0 if lb < 0.0 else lb, abs=1e-12)
    assert tuple(proof.n) == (X if lb < 0.0 else n)


def posed(shape):
    """Return one body at the origin; a cone and a hull have corners, a ball in the same table has none."""
    shapes = [Cone(0.1, 0.2), Convex(((0.1, 0, 0), (0, 0.1, 0), (0, 0, 0.1), (0, 0, 0)), 0.0), Sphere(0.1)]
    rows = {"cone": 0, "hull": 1, "ball beside them": 2}
    row = support_table(shapes)[rows[shape]] if shape in rows else support_table([Box(0.1, 0.1, 0.1)])[0]
    return certificate._Posed(0, row, np.eye(3), np.zeros(3))


@pytest.mark.parametrize(
    ("shapes", "claimed", "lb", "tried", "turned"),
    [
        (("box", "box"), 0.0, -0.1, -0.01, True),  # the engine's distance exceeds the proof
        (("box", "box"), 0.0, -0.01, -0.1, True),
        (("box", "box"), 2 * GAP, -1.0, GAP, False),  # the distance exceeds it by exactly the gap
        (("box", "box"), -0.1, -0.1, -0.1, False),
        (("box", "box"), -0.1, -0.1, -0.2, False),
        (("box", "box"), -0.1, -0.2, -0.1, False),
        (("box", "box"), -0.3, -0.3, -0.2, False),
        (("ball beside them", "box"), -0.1, -0.1, -0.1, False),
        (("cone", "box"), -0.1, -0.1, -0.1, True),
        (("box", "cone"), -0.1, -0.1, -0.1, True),
        (("hull", "ball beside them"), -0.1, -0.1, -0.1, True),
    ],
)
def test_directions_are_turned_if_the_proof_falls_short_or_a_body_has_corners(
    shapes, claimed, lb, tried, turned, monkeypatch
):
    turns = []
    monkeypatch.setattr(certificate, "best_candidate_direction", lambda *_: (np.array(X), tried))
    monkeypatch.setattr(certificate, "rotated_direction", lambda *_: turns.append(1) or (np.array(X), 5.0))
    n, found = certificate._overlap(*map(posed, shapes), np.array((0.0, 1.0, 0.0)), lb, claimed)
    assert len(turns) == turned
    assert found == (5.0 if turned else max(tried, lb))
    assert tuple(n) == (X if found > lb else (0.0, 1.0, 0.0))


@pytest.mark.parametrize(
    ("more", "replaced"), [(0.0, False), (1e-9, False), (1.5e-9, True), (-0.5e-9, False)]
)
def test_a_direction_is_replaced_by_one_that_proves_more_than_rounding(more, replaced, monkeypatch):
    found = -0.1 + more
    monkeypatch.setattr(certificate, "best_candidate_direction", lambda *_: (np.array(X), found))
    n, lb = certificate._overlap(posed("box"), posed("box"), np.array((0.0, 1.0, 0.0)), -0.1, -0.1)
    assert (lb, tuple(n)) == ((found, X) if replaced else (-0.1, (0.0, 1.0, 0.0)))


# --- engines ------------------------------------------------------------------------------------------------


def at(*t):
    return np.eye(3), np.array(t, dtype=float)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("n", [X, (0.0, -1.0, 0.0), (0.6, 0.0, -0.8)])
def test_an_engine_returns_the_direction_and_the_points_of_two_balls(engine, n):
    n, a = np.array(n), np.array([3.0, 1.0, 2.0])
    found = engine((Sphere(0.5), Sphere(0.25))).suggest(0, at(*a), 1, at(*(a + 2.0 * n)))
    assert found.distance == pytest.approx(1.25, abs=1e-6)
    assert found.normal == pytest.approx(n, abs=1e-5)
    assert found.points[0] == pytest.approx(a + 0.5 * n, abs=1e-5)
    assert found.points[1] == pytest.approx(a + 1.75 * n, abs=1e-5)


@pytest.mark.parametrize("engine", ENGINES)
def test_an_answer_does_not_depend_on_the_previous_query(engine):
    """A reused result object may keep the least distance found so far, here that of an overlap."""
    tested = engine((Convex(TIPS, 0.0), Sphere(0.25)))
    tested.suggest(0, at(0, 0, 0), 1, at(0.25, 0, 0))
    for n, apart in ((X, 1.0), ((0.0, 1.0, 0.0), 3.0), ((0.0, 0.0, -1.0), 2.0)):
        found = tested.suggest(0, at(0, 0, 0), 1, at(*(apart * x for x in n)))
        assert found.distance == pytest.approx(apart - 0.75, abs=1e-6)
        assert found.normal == pytest.approx(n, abs=1e-3)
        assert found.points[0] == pytest.approx([0.5 * x for x in n], abs=1e-3)


@pytest.mark.parametrize("engine", ENGINES)
def test_overlapping_bodies_have_a_direction_of_length_one(engine):
    found = engine((Sphere(0.5), Sphere(0.5))).suggest(0, at(3, 0, 0), 1, at(2.5, 0, 0))
    assert found.normal == pytest.approx([-1, 0, 0], abs=1e-6)
    same = engine((Sphere(0.5), Sphere(0.5))).suggest(0, at(3, 0, 0), 1, at(3, 0, 0))
    assert np.linalg.norm(same.normal) == pytest.approx(1.0, abs=1e-9)


def test_without_a_direction_an_engine_returns_up():
    found = FclEngine((Sphere(0.5), Sphere(0.5))).suggest(0, at(3, 0, 0), 1, at(3, 0, 0))
    assert tuple(found.normal) == (0.0, 0.0, 1.0)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize(("one", "other"), [(0.1, 0.0), (0.0, 0.1), (0.1, 0.2), (1.0, 1.0)])
def test_the_radius_of_a_hull_is_subtracted_on_its_side(engine, one, other):
    tested = engine((Convex(TIPS, one), Convex(TIPS, other), Sphere(0.5)))
    for b in (1, 2):
        r = other if b == 1 else 0.0
        found = tested.suggest(0, at(1, 0, 0), b, at(5, 0, 0))
        assert found.distance == pytest.approx(3.0 - one - r, abs=1e-6)
        assert found.normal == pytest.approx(X, abs=1e-6)
        assert [p[0] for p in found.points] == pytest.approx([1.5 + one, 4.5 - r], abs=1e-6)


def test_the_radii_of_hulls_move_both_points_along_the_direction():
    n, p, q = np.array([0.6, 0.0, -0.8]), np.array([1.0, 2.0, 3.0]), np.array([1.6, 2.0, 2.2])
    found = _thickened(Suggestion(1.0, n, (p, q)), 0.25, 0.5)
    assert found.distance == 0.25
    assert found.normal is n
    assert found.points[0] == pytest.approx([1.15, 2.0, 2.8], abs=1e-12)
    assert found.points[1] == pytest.approx([1.3, 2.0, 2.6], abs=1e-12)
