"""Bounds of overlapping bodies, against a dense search over all directions and by hand."""

import numpy as np
import pytest

from armgate.cell.shapes import Box, Capsule, Cone, Convex, Cylinder, Sphere
from armgate.gate.clearance.certificate import _overlap, _Posed, _slab
from armgate.gate.clearance.engines import CoalEngine
from armgate.gate.clearance.penetration import best_candidate_direction, rotated_direction, separations
from armgate.gate.clearance.support import support, support_table

PAIRS = 191


def rotation(rng):
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return q * np.sign(np.linalg.det(q))


def some_shape(rng):
    size = rng.uniform(0.05, 0.4, 3).tolist()
    corners = tuple(map(tuple, (rng.normal(size=(12, 3)) * 0.15).tolist()))
    return (
        Sphere(size[0]), Capsule(size[0] / 3, 2 * size[1]), Cylinder(size[0] / 2, size[1]), Box(*size),
        Cone(size[0] / 2, size[1]), Convex(corners, 0.01),
    )[rng.integers(6)]  # fmt: skip


def overlapping(rng):
    """Return a pair near each other; every third pair are two capsules that cross in one plane."""
    if rng.integers(3):
        shapes = some_shape(rng), some_shape(rng)
        poses = (rotation(rng), np.zeros(3)), (rotation(rng), 0.1 * rng.normal(size=3))
    else:
        shapes = tuple(Capsule(rng.uniform(0.03, 0.12), rng.uniform(0.2, 0.9)) for _ in range(2))
        R, angle = rotation(rng), rng.uniform(0.1, 3.0)
        c, s = np.cos(angle), np.sin(angle)
        turned = R @ np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
        poses = (R, np.zeros(3)), (turned, R @ np.array([0.0, *rng.uniform(-0.15, 0.15, 2)]))
    rows = support_table(shapes)
    return shapes, *(_Posed(k, rows[k], *pose) for k, pose in enumerate(poses))


def searched(a, b, rng):
    """Return the signed distance by trying 4000 directions and perturbing the best of them."""

    def room(n):
        n = n / np.linalg.norm(n, axis=1, keepdims=True)
        far = [np.array([float(support(x.row, v)) for v in m @ x.R]) for x, m in ((a, n), (b, -n))]
        return n @ (b.t - a.t) - far[0] - far[1], n

    near = [np.atleast_1d(support(x.row, np.zeros(3))) for x in (a, b)]
    assert all(np.isfinite(x).all() for x in near)
    n = rng.normal(size=(4000, 3))
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    values = separations((a.row, a.R, a.t), (b.row, b.R, b.t), n)
    check, _ = room(n[:5])
    assert check == pytest.approx(values[:5])
    best = -np.inf
    for start in n[np.argsort(-values)[:6]]:
        step, at = 0.1, start
        value = separations((a.row, a.R, a.t), (b.row, b.R, b.t), at[None])[0]
        while step > 1e-6:
            tries = at + step * rng.normal(size=(24, 3))
            tries /= np.linalg.norm(tries, axis=1, keepdims=True)
            found = separations((a.row, a.R, a.t), (b.row, b.R, b.t), tries)
            k = int(np.argmax(found))
            at, value, step = (tries[k], found[k], step) if found[k] > value else (at, value, 0.6 * step)
        best = max(best, value)
    return best


def test_bounds_of_overlapping_pairs_are_within_two_millimetres():
    rng, off, engine_off = np.random.default_rng(11), [], []
    while len(off) < PAIRS:
        shapes, a, b = overlapping(rng)
        said = CoalEngine(shapes).suggest(0, (a.R, a.t), 1, (b.R, b.t))
        lb = _slab(a, b, said.normal)
        truth = searched(a, b, rng)
        if truth > -1e-3:
            continue
        n, found = _overlap(a, b, said.normal, lb, said.distance)
        assert found == pytest.approx(_slab(a, b, n), abs=1e-12)  # the bound of the direction found
        assert found >= lb
        off.append(truth - found)
        engine_off.append(truth - lb)
    assert max(off) < 2e-3
    assert np.mean(off) < 1e-4
    assert max(engine_off) > 0.05  # without the search some bounds are far too low


@pytest.mark.parametrize("angle", [0.2, 1.0, np.pi / 2, 2.5])
@pytest.mark.parametrize("off", [0.0, 0.05])
def test_crossing_capsules_separate_perpendicular_to_both_axes(angle, off):
    """The depth is the sum of the radii less ``off``, the distance of the axes' planes."""
    rows = support_table((Capsule(0.06, 0.8), Capsule(0.04, 0.8)))
    c, s = np.cos(angle), np.sin(angle)
    turned = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    a, b = (rows[0], np.eye(3), np.zeros(3)), (rows[1], turned, np.array([off, 0.01, 0.02]))
    for direction in (best_candidate_direction, rotated_direction):
        n, found = direction(a, b, np.array([0.0, 0.0, 1.0]))
        assert found == pytest.approx(off - 0.1, abs=1e-9)
        assert abs(n[0]) == pytest.approx(1.0)


SHIFT = np.array([1.0, -2.0, 3.0])
UP = np.array([0.0, 0.0, 1.0])
FIRST = np.array([[2, -1, 2], [2, 2, -1], [-1, 2, 2]]) / 3
SECOND = np.array([[2, 3, 6], [3, -6, 2], [6, 2, -3]]) / 7


@pytest.mark.parametrize("shift", [np.zeros(3), SHIFT])
def test_balls_separate_along_the_line_of_their_centres_anywhere(shift):
    rows = support_table((Sphere(0.3), Sphere(0.2)))
    a, b = (rows[0], np.eye(3), shift), (rows[1], np.eye(3), shift + np.array([0.03, 0.0, -0.04]))
    assert separations(a, b, np.array([UP, -UP])) == pytest.approx([-0.54, -0.46])
    for direction in (best_candidate_direction, rotated_direction):
        n, found = direction(a, b, UP)
        assert found == pytest.approx(-0.45)
        assert n == pytest.approx([0.6, 0.0, -0.8])


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("first", [True, False])
def test_a_ball_leaves_a_box_to_either_side(axis, sign, first):
    """The ball's frame is turned, so that only the axes of the box are normals of its faces."""
    rows, off = support_table((Box(0.4, 0.4, 0.4), Sphere(0.1))), np.full(3, 0.05)
    off[axis] = sign * 0.1
    pair = [(rows[0], np.eye(3), SHIFT), (rows[1], FIRST, SHIFT + off)]
    a, b = pair if first else pair[::-1]
    for n in np.eye(3):
        found, room = best_candidate_direction(a, b, n)
        assert room == pytest.approx(-0.2)
        assert found == pytest.approx((sign if first else -sign) * np.eye(3)[axis])


def test_of_directions_with_equal_proofs_the_given_one_is_kept():
    rows = support_table((Sphere(0.3), Sphere(0.2)))
    a, b = (rows[0], np.eye(3), SHIFT), (rows[1], np.eye(3), SHIFT)
    for direction in (best_candidate_direction, rotated_direction):
        for n in (UP, -UP):
            kept, found = direction(a, b, n)
            assert tuple(kept) == tuple(n)
            assert found == -0.5


@pytest.mark.parametrize(
    ("cone", "ball", "angle"),
    [(FIRST, SECOND, 2.0), (FIRST, SECOND, 2.9), (np.eye(3), SECOND, 1.2), (SECOND, FIRST, 2.0)],
)
def test_turning_finds_the_side_of_a_cone_to_hundredths_of_a_millimetre(cone, ball, angle):
    """A ball in a cone leaves through its side, whose normal is not among the directions tried."""
    radius, length, of_ball = 0.2, 0.5, 0.03
    rows, side = support_table((Cone(radius, length), Sphere(of_ball))), np.hypot(radius, length)
    out = np.array([np.cos(angle), np.sin(angle), 0.0])
    normal, centre = (length * out + radius * UP) / side, 0.04 * out - 0.02 * UP
    truth = normal @ (centre - 0.5 * length * UP) - of_ball
    a, b = (rows[0], cone, SHIFT), (rows[1], ball, SHIFT + cone @ centre)
    _, found = rotated_direction(a, b, cone @ UP)
    assert truth - 5e-5 < found <= truth + 1e-12
    assert best_candidate_direction(a, b, cone @ UP)[1] < truth - 5e-3


def test_turning_finds_directions_that_are_not_axes():
    """Two hulls whose face normals are not their axes."""
    rng = np.random.default_rng(3)
    corners = [tuple(map(tuple, (rng.normal(size=(9, 3)) * 0.1).tolist())) for _ in range(2)]
    rows = support_table([Convex(x, 0.0) for x in corners])
    a, b = (rows[0], np.eye(3), np.zeros(3)), (rows[1], rotation(rng), np.array([0.05, 0.02, 0.0]))
    n = np.array([0.0, 0.0, 1.0])
    tried, turned = best_candidate_direction(a, b, n)[1], rotated_direction(a, b, n)[1]
    posed = [_Posed(0, *a), _Posed(1, *b)]
    truth = searched(*posed, rng)
    assert tried < turned - 1e-3
    assert truth - turned < 5e-3
