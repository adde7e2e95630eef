"""Bodies of the oracle: their reach, the points that they contain, and their form in the engines.

Written by hand for every kind, without code of the gate: a convex body is the hull of its corners, widened by
a radius. It contains a point if the nearest point of the hull is within the radius.
"""

import math
from dataclasses import dataclass, field
from itertools import combinations

import coal
import fcl
import numpy as np


@dataclass(frozen=True, eq=False)
class Solid:
    """Body of a kind with sizes (and corners), and a thick segment that contains it."""

    name: str
    kind: str
    size: tuple[float, ...]
    corners: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))

    @property
    def exact(self) -> bool:
        """True if the body is the thick segment."""
        return self.kind in ("sphere", "capsule")

    @property
    def round(self) -> float:
        """Radius that the engines' shape of the body lacks, m."""
        return self.size[0] if self.kind == "convex" else 0.0

    def hull(self) -> tuple[np.ndarray, float]:
        """Return half the segment, in the body's frame, and the thickness."""
        s = self.size
        if self.kind == "sphere":
            return np.zeros(3), s[0]
        if self.kind in ("capsule", "cylinder", "cone"):
            return np.array([0.0, 0.0, s[1] / 2]), s[0]
        sides = np.array(s) / 2 if self.kind == "box" else np.abs(self.corners).max(axis=0)
        half = np.where(np.arange(3) == np.argmax(sides), sides, 0.0)
        if self.kind == "box":
            return half, float(np.linalg.norm(sides - half))
        off = self.corners - np.clip(self.corners, -half, half)
        return half, float(np.linalg.norm(off, axis=1).max()) + s[0]

    def reach(self, v: np.ndarray) -> float:
        """Return max v·x over the body, for v in its frame."""
        s, length = self.size, float(np.linalg.norm(v))
        if self.kind == "sphere":
            return s[0] * length
        if self.kind == "capsule":
            return s[1] / 2 * abs(v[2]) + s[0] * length
        if self.kind == "cylinder":
            return s[1] / 2 * abs(v[2]) + s[0] * math.hypot(v[0], v[1])
        if self.kind == "cone":
            return max(s[1] / 2 * v[2], s[0] * math.hypot(v[0], v[1]) - s[1] / 2 * v[2])
        if self.kind == "convex":
            return float((self.corners @ v).max()) + s[0] * length
        return float(np.abs(v) @ np.array(s)) / 2

    def reaches(self, v: np.ndarray) -> np.ndarray:
        """Return `reach` for many v of length one, (m, 3)."""
        s, x = self.size, np.abs(v)
        if self.kind == "sphere":
            return np.full(len(v), s[0])
        if self.kind == "capsule":
            return s[1] / 2 * x[:, 2] + s[0]
        if self.kind == "cylinder":
            return s[1] / 2 * x[:, 2] + s[0] * np.hypot(x[:, 0], x[:, 1])
        if self.kind == "cone":
            tip = s[1] / 2 * v[:, 2]
            return np.maximum(tip, s[0] * np.hypot(v[:, 0], v[:, 1]) - tip)
        if self.kind == "convex":
            return (v @ self.corners.T).max(axis=1) + s[0]
        return x @ np.array(s) / 2

    def holds(self, x: np.ndarray, slack: float) -> bool:
        """Return True if a point of the body's frame lies in the body."""
        s = self.size
        if self.kind == "box":
            return bool(np.all(np.abs(x) <= np.array(s) / 2 + slack))
        if self.kind == "sphere":
            return float(np.linalg.norm(x)) <= s[0] + slack
        if self.kind == "convex":
            return float(np.linalg.norm(x - nearest_in_hull(self.corners, x))) <= s[0] + slack
        level, high = math.hypot(x[0], x[1]), abs(x[2]) <= s[1] / 2 + slack
        if self.kind == "cylinder":
            return level <= s[0] + slack and high
        if self.kind == "cone":
            side = math.hypot(s[0], s[1])  # distance from the slope, perpendicular to it
            return high and (level * s[1] - s[0] * (s[1] / 2 - x[2])) / side <= slack
        return math.hypot(level, x[2] - min(max(x[2], -s[1] / 2), s[1] / 2)) <= s[0] + slack

    def for_fcl(self):
        """Return the body without its radius, for python-fcl."""
        if self.kind == "convex":
            vertices, faces = hull_faces(self.corners)
            sides = np.column_stack([np.full(len(faces), 3), faces])
            return fcl.Convex(np.ascontiguousarray(vertices), len(faces), sides.ravel())
        kinds = {
            "sphere": fcl.Sphere, "capsule": fcl.Capsule, "cylinder": fcl.Cylinder, "box": fcl.Box,
            "cone": fcl.Cone,
        }  # fmt: skip
        return kinds[self.kind](*self.size)

    def for_coal(self):
        """Return the body without its radius, for coal."""
        if self.kind == "convex":
            points = coal.StdVec_Vec3s()
            points.extend(list(self.corners))
            return coal.Convex.convexHull(points, True, "Qt")
        kinds = {
            "sphere": coal.Sphere, "capsule": coal.Capsule, "cylinder": coal.Cylinder, "box": coal.Box,
            "cone": coal.Cone,
        }  # fmt: skip
        return kinds[self.kind](*self.size)


def nearest_in_hull(corners: np.ndarray, x: np.ndarray, enough: float = 1e-12) -> np.ndarray:
    """Return the point of a hull that is nearest to x (Wolfe's algorithm); always a point of the hull."""
    points = corners - x
    active = [int(np.argmin(np.einsum("ki,ki->k", points, points)))]
    weights = np.ones(1)
    for _ in range(200):
        y = weights @ points[active]
        ahead = int(np.argmin(points @ y))
        if y @ y - points[ahead] @ y <= enough or ahead in active:
            break
        active, weights = [*active, ahead], np.append(weights, 0.0)
        active, weights = _least_norm(points, active, weights)
    return x + weights @ points[active]


def _least_norm(points: np.ndarray, active: list[int], weights: np.ndarray):
    """Move from these weights to the point of least norm of the hull of the active corners."""
    while True:
        P = points[active]
        ones = np.ones((len(active), 1))
        system = np.block([[P @ P.T, ones], [ones.T, np.zeros((1, 1))]])
        right = np.append(np.zeros(len(active)), 1.0)
        affine = np.linalg.lstsq(system, right, rcond=None)[0][:-1]
        if np.all(affine >= -1e-14):
            affine = np.maximum(affine, 0.0)
            return active, affine / affine.sum()
        down = affine < 0.0
        share = float(np.min(weights[down] / np.maximum(weights[down] - affine[down], 1e-300)))
        weights = np.maximum(weights + share * (affine - weights), 0.0)
        keep = weights > 1e-14
        if keep.all():
            keep[int(np.argmin(weights))] = False
        active = [a for a, k in zip(active, keep, strict=True) if k]
        weights = weights[keep] / weights[keep].sum()


def hull_faces(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners of a hull and its faces as triangles, by trying all triples of few corners.

    A face with more than three corners is cut into a fan around its first corner.
    """
    span = float(np.ptp(corners, axis=0).max())
    faces: dict[frozenset[int], list[int]] = {}
    for three in combinations(range(len(corners)), 3):
        a, b, c = corners[list(three)]
        n = np.cross(b - a, c - a)
        length = float(np.linalg.norm(n))
        if length < 1e-10 * span * span:
            continue
        beyond = (corners - a) @ n / length
        if beyond.max() <= 1e-9 * span or beyond.min() >= -1e-9 * span:
            outward = n if beyond.max() <= 1e-9 * span else -n
            on = np.flatnonzero(np.abs(beyond) <= 1e-9 * span)
            faces.setdefault(frozenset(on.tolist()), _around(corners, on, outward))
    fans = [(f[0], f[k], f[k + 1]) for f in faces.values() for k in range(1, len(f) - 1)]
    used = sorted({k for fan in fans for k in fan})
    place = {k: i for i, k in enumerate(used)}
    return corners[used], np.array([[place[k] for k in fan] for fan in fans])


def _around(corners: np.ndarray, on: np.ndarray, outward: np.ndarray) -> list[int]:
    """Return the corners of one face in counterclockwise order, seen from outside."""
    middle = corners[on].mean(axis=0)
    u = corners[on[0]] - middle
    v = np.cross(outward, u)
    v = v * np.linalg.norm(u) / np.linalg.norm(v)
    off = corners[on] - middle
    return [int(k) for k in on[np.argsort(np.arctan2(off @ v, off @ u))]]
