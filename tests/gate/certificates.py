"""Certificates of the gate for random pairs of all shapes, against the distance found by a second method.

The second method shares no code with the gate: Wolfe's algorithm for the point of least norm in the
difference of two bodies. It ends with a point of either body, so the distance of these two points is an upper
bound of the true distance in any case. It also returns a bound of its own error.

PAIRS=100000 python tests/gate/certificates.py
"""

import math
import os
import sys
from collections import defaultdict
from types import SimpleNamespace

import numpy as np

from armgate.cell.shapes import Box, Capsule, Cone, Convex, Cylinder, Sphere
from armgate.gate.clearance.certificate import GAP, Certifier
from armgate.gate.clearance.pair_groups import Group
from armgate.gate.clearance.support import support_table
from armgate.gate.clearance.swept import Swept

KINDS = ("sphere", "capsule", "cylinder", "box", "cone", "convex", "rounded")
ROUNDING = 1e-12
_EACH = 6
_REPEAT = 50


def random_shape(kind, rng):
    a, b, c = (float(x) for x in np.exp(rng.uniform(math.log(0.01), math.log(0.5), 3)))
    if kind in ("convex", "rounded"):
        points = rng.normal(size=(int(rng.integers(4, 60)), 3)) * (a, b, c)
        return Convex.centred(points, a / 4 if kind == "rounded" else 0.0)[0]
    if kind == "sphere":
        return Sphere(a)
    if kind == "box":
        return Box(a, b, c)
    return {"capsule": Capsule, "cylinder": Cylinder, "cone": Cone}[kind](a, b)


def random_rotation(rng):
    w, x, y, z = (q := rng.normal(size=4)) / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


# --- the second method --------------------------------------------------------------------------------------


def farthest(shape, d):
    """Return a point of the shape, in its own frame, that is farthest along d."""
    length = math.sqrt(d @ d)
    level = math.hypot(d[0], d[1])
    rim = np.array([d[0], d[1], 0.0]) / level if level > 0 else np.zeros(3)
    up = np.array([0.0, 0.0, math.copysign(1.0, d[2])])
    match shape:
        case Sphere(radius=r):
            return r * d / length
        case Capsule(radius=r, length=h):
            return r * d / length + up * h / 2
        case Cylinder(radius=r, length=h):
            return r * rim + up * h / 2
        case Box(x=x, y=y, z=z):
            return np.copysign((x / 2, y / 2, z / 2), d)
        case Cone(radius=r, length=h):
            tip, base = np.array([0.0, 0.0, h / 2]), r * rim - np.array([0.0, 0.0, h / 2])
            return tip if tip @ d > base @ d else base
        case Convex(vertices=vertices, radius=r):
            points = np.array(vertices)
            return points[np.argmax(points @ d)] + r * d / length


def least_distance(a, pose_a, b, pose_b, rounds=100, enough=1e-7):
    """Return (upper, error): the distance is at most ``upper``, and at least ``upper`` less ``error``."""

    def extreme(d):
        R, t = pose_a
        S, s = pose_b
        return R @ farthest(a, d @ R) + t - S @ farthest(b, -d @ S) - s

    points, weights = [extreme(pose_b[1] - pose_a[1] + 1e-9)], np.ones(1)
    x, error = points[0], math.inf
    for _ in range(rounds):
        norm = math.sqrt(x @ x)
        if norm < enough:
            return norm, norm
        p = extreme(-x)
        error = min(error, norm - x @ p / norm)
        if error < enough or any(np.array_equal(p, q) for q in points):
            break
        points, weights = _least_norm([*points, p], np.append(weights, 0.0))
        x = weights @ np.array(points)
    return math.sqrt(x @ x), error


def _least_norm(points, weights):
    """Run Wolfe's minor cycle: from these weights to the point of least norm in the hull of some points."""
    while True:
        P = np.array(points)
        n = len(points)
        system = np.block([[P @ P.T, np.ones((n, 1))], [np.ones((1, n)), np.zeros((1, 1))]])
        try:
            affine = np.linalg.solve(system, np.append(np.zeros(n), 1.0))[:n]
        except np.linalg.LinAlgError:
            affine = np.linalg.lstsq(system, np.append(np.zeros(n), 1.0), rcond=1e-14)[0][:n]
        if np.all(affine > 1e-12):
            return points, affine / affine.sum()
        low = affine <= 1e-12
        drop = weights[low] / np.maximum(weights[low] - affine[low], 1e-300)
        step = min(1.0, float(drop.min()))
        moved = weights + step * (affine - weights)
        gone = low & (moved <= 1e-12)
        gone[np.flatnonzero(low)[np.argmin(drop)]] = True
        points = [p for p, g in zip(points, gone, strict=True) if not g]
        weights = moved[~gone] / moved[~gone].sum()


# --- the certificates -----------------------------------------------------------------------------------


def scene(rng):
    """Return kinds, shapes, the gate's certifier, and a group of all pairs of shapes, none of which moves."""
    kinds = [kind for kind in KINDS for _ in range(_EACH)]
    shapes = [random_shape(kind, rng) for kind in kinds]
    certifier = Certifier(SimpleNamespace(bodies=[SimpleNamespace(shape=shape) for shape in shapes]))
    rows = support_table(shapes)
    count = len(shapes)
    mine, theirs = (grid.ravel() for grid in np.meshgrid(np.arange(count), np.arange(count)))
    zeros = np.zeros((len(mine), 0))
    group = Group(
        other=None, ids=np.arange(len(mine)), mine=mine, theirs=theirs, sign=np.ones(len(mine)),
        limit=np.zeros(len(mine)), shape_mine=mine, shape_theirs=theirs,
        rows_mine=rows[mine], rows_theirs=rows[theirs], growth=zeros,
    )  # fmt: skip
    return kinds, shapes, certifier, group


def standing(R, t):
    none = np.zeros((len(t), 0))
    return Swept(np.zeros((1, 0)), np.zeros(0), lambda: (R[None], t[None]), none, none[:, :, None])


def compare(pairs, seed):
    """Return rows (kinds, certified, upper, error, slab) of random pairs, and the share of second queries."""
    rng = np.random.default_rng(seed)
    rows, gaps = [], 0
    while len(rows) < pairs:
        kinds, shapes, certifier, group = scene(rng)
        for _ in range(_REPEAT):
            sides = [
                (np.array([random_rotation(rng) for _ in shapes]), rng.uniform(-0.6, 0.6, (len(shapes), 3)))
                for _ in range(2)
            ]
            mine, theirs = (standing(R, t) for R, t in sides)
            for k in rng.choice(len(group.ids), size=len(shapes), replace=False):
                i, j = int(group.mine[k]), int(group.theirs[k])
                proof = certifier.prove(group, int(k), mine, theirs, (0, 0))
                slab = group.slab(mine, theirs, np.array([k]), proof.n[None])[0][0]
                poses = [(R[body], t[body]) for (R, t), body in zip(sides, (i, j), strict=True)]
                upper, error = least_distance(shapes[i], poses[0], shapes[j], poses[1])
                rows.append(((kinds[i], kinds[j]), proof.lb, upper, error, slab))
        gaps += certifier.gaps
    return rows[:pairs], gaps / len(rows)


def write_line(text):
    sys.stdout.write(text + "\n")


def main():
    pairs = int(os.environ.get("PAIRS", "100000"))
    found, gaps = compare(pairs, seed=11)
    table = defaultdict(list)
    for kinds, certified, upper, error, _ in found:
        table[tuple(sorted(kinds))].append((certified, upper, error))
    write_line(
        f"{'pair':22} {'count':>6} {'apart':>6} {'worst lb - truth':>17} {'largest truth - lb':>19}  m"
    )
    wrong = 0
    for kinds, rows in sorted(table.items()):
        certified, upper, error = np.array(rows).T
        apart = upper > GAP
        loose = (upper - certified)[apart & (error < GAP / 10)]
        wrong += int(np.count_nonzero(certified > upper + ROUNDING))
        worst = (certified - upper).max()
        write_line(
            f"{' - '.join(kinds):22} {len(rows):6} {np.count_nonzero(apart):6} {worst:17.2e} "
            f"{loose.max(initial=0.0):19.2e}"
        )
    write_line(f"pairs: {len(found)}, second queries: {gaps:.4%}")
    write_line(f"certificates above the truth: {wrong}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
