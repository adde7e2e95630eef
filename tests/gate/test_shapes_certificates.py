"""Certificates for all pairs of shapes against a second method; the long form is ``make certificates``."""

import numpy as np
import pytest

from armgate.cell.shapes import Box, Capsule, Cone, Convex, Cylinder, Sphere
from armgate.gate.clearance import certificate
from armgate.gate.clearance.certificate import GAP
from armgate.gate.clearance.engines import CoalEngine, FclEngine, Suggestion
from armgate.gate.clearance.support import Cornered, support, support_of_one, support_table
from gate.certificates import (
    KINDS,
    ROUNDING,
    compare,
    farthest,
    least_distance,
    random_rotation,
    random_shape,
    scene,
    standing,
)


@pytest.mark.slow
def test_no_certificate_is_above_the_true_distance_and_all_are_close_to_it():
    rows, gaps = compare(2500, seed=5)
    assert {frozenset(kinds) for kinds, *_ in rows} == {frozenset((a, b)) for a in KINDS for b in KINDS}
    for kinds, certified, upper, error, slab in rows:
        assert certified <= upper + ROUNDING, kinds
        assert slab == pytest.approx(certified, abs=1e-12), kinds
        if upper > GAP and error < GAP / 10:
            assert certified >= upper - GAP, kinds
    assert gaps < 0.01


def test_the_second_method_finds_known_distances():
    """The certificates are checked by it, so it is checked by hand."""
    here, there = (np.eye(3), np.zeros(3)), (np.eye(3), np.array([0.0, 0.0, 2.0]))
    tip = Cone(0.3, 1.0)
    for a, b, distance in (
        (Sphere(0.5), Sphere(0.25), 1.25),
        (tip, Box(1, 1, 1), 1.0),  # tip to face
        (Box(1, 1, 1), tip, 1.0),  # base to face
        (Cylinder(0.1, 0.5), Capsule(0.25, 0.5), 1.25),
    ):
        upper, error = least_distance(a, here, b, there)
        assert upper == pytest.approx(distance, abs=1e-6)
        assert error < 1e-6


@pytest.mark.parametrize("kind", KINDS)
def test_support_is_the_reach_of_the_farthest_point(kind):
    rng = np.random.default_rng(KINDS.index(kind))
    shapes = [random_shape(kind, rng) for _ in range(20)]
    table = support_table(shapes)
    v = rng.normal(size=(3, 20, 3))
    v /= np.linalg.norm(v, axis=-1, keepdims=True)
    expected = [[d @ farthest(shape, d) for shape, d in zip(shapes, row, strict=True)] for row in v]
    assert support(table, v) == pytest.approx(np.array(expected), abs=1e-14)


@pytest.mark.parametrize("kind", KINDS)
def test_support_of_one_body_equals_its_entry_of_the_table(kind):
    """Certificates query one body at a time; for a primitive, its row of the table contains all data."""
    rng = np.random.default_rng(KINDS.index(kind))
    shapes = [random_shape(kind, rng) for _ in range(20)]
    table, v = support_table(shapes), rng.normal(size=(20, 3))
    v[:3] = np.eye(3)
    v /= np.linalg.norm(v, axis=1, keepdims=True)
    expected = [d @ farthest(shape, d) for shape, d in zip(shapes, v, strict=True)]
    assert [support_of_one(table[k], v[k]) for k in range(20)] == pytest.approx(expected, abs=1e-14)
    assert [support_of_one(table[k], v[k]) for k in range(20)] == support(table, v).tolist()


def test_tables_with_hulls_give_equal_values_for_selections_and_single_bodies():
    rng = np.random.default_rng(1)
    shapes = [random_shape(kind, rng) for kind in KINDS for _ in range(3)]
    table = support_table(shapes)
    assert isinstance(table, Cornered)
    assert len(table) == len(shapes)
    v = rng.normal(size=(len(shapes), 3))
    v /= np.linalg.norm(v, axis=1, keepdims=True)
    whole = support(table, v)
    sel = np.array([20, 0, 7, 7, 13])
    assert np.array_equal(support(table[sel], v[sel]), whole[sel])
    assert [float(support(table[k], v[k])) for k in range(len(shapes))] == pytest.approx(
        whole.tolist(), abs=1e-15
    )
    assert support(table[np.array([], dtype=np.intp)], v[:0]).shape == (0,)


def test_the_support_table_of_primitives_is_an_array():
    assert isinstance(support_table([Sphere(1.0), Box(1, 1, 1), Cylinder(1, 1), Capsule(1, 1)]), np.ndarray)


@pytest.mark.parametrize("engine", [CoalEngine, FclEngine])
def test_engines_find_the_sides_of_cones_and_hulls(engine):
    corners = ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))
    hull, (x, y, z) = Convex.centred(corners, radius=0.1)
    shapes = (Cone(0.2, 1.0), hull, Sphere(0.01))
    asked = engine(shapes)

    def at(*t):
        return np.eye(3), np.array(t, dtype=float)

    tip = asked.suggest(0, at(0, 0, 0), 2, at(0, 0, 1))
    assert tip.distance == pytest.approx(0.49, abs=1e-6)
    assert tip.normal == pytest.approx([0, 0, 1], abs=1e-3)
    base = asked.suggest(0, at(0, 0, 0), 2, at(0.05, 0, -1))
    assert base.distance == pytest.approx(0.49, abs=1e-6)
    found = asked.suggest(1, at(x, y, z), 2, at(0.2, 0.2, -0.5))
    assert found.distance == pytest.approx(0.5 - 0.1 - 0.01, abs=1e-6)
    assert found.points[0] == pytest.approx([0.2, 0.2, -0.1], abs=1e-4)
    assert found.points[1] == pytest.approx([0.2, 0.2, -0.49], abs=1e-4)


def test_hulls_inside_rounded_bodies_that_touch_still_have_a_direction():
    cube = tuple((x, y, z) for x in (-0.1, 0.1) for y in (-0.1, 0.1) for z in (-0.1, 0.1))
    shapes = (Convex(cube, 0.05), Convex(cube, 0.05))
    far = (np.eye(3), np.array([0.25, 0.0, 0.0]))
    found = CoalEngine(shapes).suggest(0, (np.eye(3), np.zeros(3)), 1, far)
    assert found.distance == pytest.approx(-0.05)
    assert found.normal == pytest.approx([1, 0, 0], abs=1e-6)


class Mistaken:
    """Engine with an arbitrary answer."""

    def __init__(self, distance, normal):
        self.said = Suggestion(distance, np.array(normal, dtype=float), (np.zeros(3), np.zeros(3)))

    def suggest(self, *asked):
        return self.said


@pytest.mark.parametrize("distance", [5.0, -1.7976931348623157e308])
def test_a_wrong_engine_is_detected_and_the_other_one_queried(distance, monkeypatch):
    """The distance is too large, or the number that coal returns when it gives up on overlapping bodies."""
    rng = np.random.default_rng(2)
    monkeypatch.setattr(certificate, "CoalEngine", lambda shapes: Mistaken(distance, [0, 0, 1]))
    _, shapes, certifier, group = scene(rng)
    R = np.array([random_rotation(rng) for _ in shapes])
    t = np.zeros((len(shapes), 3))
    mine, theirs = standing(R, t), standing(R, t + np.array([2.0, 0.0, 0.0]))
    for k in rng.choice(len(group.ids), 50, replace=False):
        proof = certifier.prove(group, int(k), mine, theirs, (0, 0))
        i, j = int(group.mine[k]), int(group.theirs[k])
        upper, _ = least_distance(shapes[i], mine.pose(0, i), shapes[j], theirs.pose(0, j))
        assert upper - 0.01 < proof.lb <= upper + ROUNDING
    assert certifier.gaps == 50
