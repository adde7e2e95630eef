"""Oracle that shares no code with the gate: motion and distances of bodies, bounds of joints.

Kinematics: numpy, many positions at once, from the robot's URDF text. Distance: python-fcl first. It
over-reports, so its result is bracketed by the oracle's own bounds: from above by points that lie in the
bodies (a closer pair of points proves a violation), from below by planes (they prove that there is none).
"""

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import coal
import fcl
import numpy as np

from armgate.cell.cell import Cell
from gate.solids import Solid

TINY = 2e-7
"""Largest total rounding of the kinematics, both engines and the bounds below, m."""

NEAR = 0.05
"""Pairs farther from their limit than this are not examined further, m."""


def rotation(rpy: Sequence[float]) -> np.ndarray:
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def _numbers(element: ET.Element | None, key: str, default: str) -> np.ndarray:
    return np.array([float(x) for x in (default if element is None else element.get(key, default)).split()])


def _pose(element: ET.Element) -> tuple[np.ndarray, np.ndarray]:
    origin = element.find("origin")
    return rotation(_numbers(origin, "rpy", "0 0 0")), _numbers(origin, "xyz", "0 0 0")


class Arm:
    """Kinematics of one robot from its URDF text."""

    def __init__(self, text: str, xyz: Sequence[float], rpy: Sequence[float]) -> None:
        root = ET.fromstring(text)
        self._base = rotation(rpy), np.array(xyz, dtype=float)
        self._joints = {j.find("child").get("link"): j for j in root.findall("joint")}
        self._links = {link.get("name"): link for link in root.findall("link")}
        self._order = self._sorted()
        self.moving = [n for n in self._order if n in self._joints and self._joints[n].get("type") != "fixed"]
        self.solids: list[Solid] = []
        self._places: list[tuple[str, np.ndarray, np.ndarray]] = []
        for link in self._links.values():
            for number, c in enumerate(link.findall("collision"), 1):
                shape = c.find("geometry")[0]
                fallback = link.get("name") + ("" if number == 1 else f"_{number}")
                size = (
                    _numbers(shape, "size", "")
                    if shape.tag == "box"
                    else [float(shape.get(k)) for k in ("radius", "length") if shape.get(k) is not None]
                )
                corners = _numbers(shape, "vertices", "").reshape(-1, 3)
                name = c.get("name", fallback)
                self.solids.append(Solid(name, shape.tag, tuple(map(float, size)), corners))
                self._places.append((link.get("name"), *_pose(c)))

    def _sorted(self) -> list[str]:
        """Return the links from the base on, depth first, in the order of their joints' names."""
        (root,) = [n for n in self._links if n not in self._joints]
        order, stack = [], [root]
        while stack:
            link = stack.pop()
            order.append(link)
            children = [c for c, j in self._joints.items() if j.find("parent").get("link") == link]
            stack += sorted(children, key=lambda c: self._joints[c].get("name"), reverse=True)
        return order

    def joint_names(self) -> list[str]:
        return [self._joints[n].get("name") for n in self.moving]

    def place(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return R (m, nb, 3, 3) and t (m, nb, 3) of the bodies at positions q (m, n)."""
        m = len(q)
        R, t = {}, {}
        for link in self._order:
            if link not in self._joints:
                R[link] = np.broadcast_to(self._base[0], (m, 3, 3))
                t[link] = np.broadcast_to(self._base[1], (m, 3))
                continue
            j = self._joints[link]
            parent = j.find("parent").get("link")
            Rj, tj = _pose(j)
            R[link], t[link] = R[parent] @ Rj, t[parent] + R[parent] @ tj
            if j.get("type") != "fixed":
                axis = _numbers(j.find("axis"), "xyz", "1 0 0")
                axis = axis / np.linalg.norm(axis)
                x = q[:, self.moving.index(link)]
                if j.get("type") == "prismatic":
                    t[link] = t[link] + x[:, None] * (R[link] @ axis)
                else:
                    R[link] = R[link] @ _turn(axis, x)
        Rs = [R[link] @ Rb for link, Rb, _ in self._places]
        ts = [t[link] + R[link] @ tb for link, _, tb in self._places]
        if not Rs:
            return np.zeros((m, 0, 3, 3)), np.zeros((m, 0, 3))
        return np.stack(Rs, axis=1), np.stack(ts, axis=1)


def _turn(axis: np.ndarray, angle: np.ndarray) -> np.ndarray:
    x, y, z = axis
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle)[:, None, None] * K + (1 - np.cos(angle))[:, None, None] * (K @ K)


def segments_apart(p, u, q, v) -> np.ndarray:
    """Return the distance of segments p ± u and q ± v, (…, 3) each.

    It is the smallest of the distances with the first segment's point at the free minimum and at both ends.
    """
    w = q - p
    a, b, c = (np.sum(x * y, axis=-1) for x, y in ((u, u), (u, v), (v, v)))
    d, e = np.sum(u * w, axis=-1), np.sum(v * w, axis=-1)
    det = a * c - b * b
    s = np.divide(c * d - b * e, det, out=np.zeros_like(det), where=det > 1e-14)
    best = np.full(w.shape[:-1], np.inf)
    for s_try in (np.clip(s, -1, 1), np.ones_like(s), -np.ones_like(s)):
        t = np.clip(np.divide(b * s_try - e, c, out=np.zeros_like(c), where=c > 1e-18), -1, 1)
        s_in = np.clip(np.divide(d + b * t, a, out=np.zeros_like(a), where=a > 1e-18), -1, 1)
        gap = w + t[..., None] * v - s_in[..., None] * u
        best = np.minimum(best, np.sqrt(np.sum(gap * gap, axis=-1)))
    return best


@dataclass(frozen=True)
class Apart:
    """Distance of two bodies: ``low`` is proven by a plane, ``high`` by two points."""

    low: float
    high: float
    normal: np.ndarray


class Oracle:
    """Distances of all pairs of a cell at any positions of its robots."""

    def __init__(self, cell: Cell) -> None:
        self.cell = cell
        self.arms = [Arm(r.urdf, r.config.base.xyz, r.config.base.rpy) for r in cell.robots]
        for arm, robot in zip(self.arms, cell.robots, strict=True):
            assert arm.joint_names() == [j.name for j in robot.model.joints]
        self.solids, names = [], []
        self._slices = []
        for arm, robot in zip(self.arms, cell.robots, strict=True):
            self._slices.append(slice(len(self.solids), len(self.solids) + len(arm.solids)))
            self.solids += arm.solids
            names += [f"{robot.name}/{s.name}" for s in arm.solids]
        placed = []
        for name, given in cell.config.surroundings.items():
            ((kind, size),) = [(k, v) for k, v in given.shape.model_dump().items() if v is not None]
            if kind == "mesh":  # its parts are given: another test checks that they contain the mesh
                parts = [b for b in cell.bodies if b.robot is None and b.name.split("/")[0] == name]
                for b in parts:
                    corners = np.array(b.shape.vertices)
                    self.solids.append(Solid(b.name, "convex", (b.shape.radius,), corners))
                    placed.append((np.array(b.placement.R), np.array(b.placement.t)))
                    names.append(b.name)
                continue
            self.solids.append(Solid(name, kind, tuple(size) if isinstance(size, list | tuple) else (size,)))
            placed.append((rotation(given.rpy), np.array(given.xyz)))
            names.append(name)
        self._fixed = placed
        at = {name: k for k, name in enumerate(names)}
        self.names = names
        self.pairs = [(at[cell.bodies[p.a].name], at[cell.bodies[p.b].name]) for p in cell.pairs]
        self.limits = np.array([p.limit for p in cell.pairs])
        self._a, self._b = np.array(self.pairs, dtype=int).reshape(-1, 2).T
        hulls = [s.hull() for s in self.solids]
        self._half, self._thick = np.array([h for h, _ in hulls]), np.array([r for _, r in hulls])
        exact = np.array([s.exact for s in self.solids])
        self.exact = exact[self._a] & exact[self._b]
        self._fcl, self._coal = [s.for_fcl() for s in self.solids], [s.for_coal() for s in self.solids]
        self._request = coal.DistanceRequest()
        self._request.gjk_tolerance = self._request.epa_tolerance = 1e-9
        self.gaps = 0

    # --- many positions at once ---------------------------------------------------------------------------

    def place(self, qs: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """Return R (m, nb, 3, 3), t (m, nb, 3) of all bodies for q (m, n) of every robot."""
        m = len(qs[0])
        parts = [arm.place(np.asarray(q, dtype=float)) for arm, q in zip(self.arms, qs, strict=True)]
        if self._fixed:
            R, t = (np.array(x) for x in zip(*self._fixed, strict=True))
            parts.append((np.broadcast_to(R, (m, *R.shape)), np.broadcast_to(t, (m, *t.shape))))
        return np.concatenate([p[0] for p in parts], 1), np.concatenate([p[1] for p in parts], 1)

    def below(self, R: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Return lower bounds of the distances of all pairs, (m, pairs).

        They are the distances of enclosing balls, and for near pairs of enclosing thick segments, which are
        exact for spheres and capsules.
        """
        around = np.linalg.norm(self._half, axis=1) + self._thick
        v = t[:, self._b] - t[:, self._a]
        low = np.sqrt(np.einsum("mpi,mpi->mp", v, v)) - around[self._a] - around[self._b]
        m, p = np.nonzero(low < self.limits + NEAR)
        u = np.einsum("mbij,bj->mbi", R, self._half)
        a, b = self._a[p], self._b[p]
        d = segments_apart(t[m, a], u[m, a], t[m, b], u[m, b])
        low[m, p] = d - self._thick[a] - self._thick[b]
        return low

    def least(self, qs: Sequence[np.ndarray], need: np.ndarray | None = None) -> "Least":
        """Return the smallest distance over the positions, and every pair proven below its need."""
        need = self.limits if need is None else need
        R, t = self.place(qs)
        low = self.below(R, t)
        smallest, where, broken = np.inf, None, []
        sure = self.exact[None, :] & (low > 0)
        margin = np.where(sure, low - need, np.inf)
        if margin.size:
            at = np.unravel_index(np.argmin(margin), margin.shape)
            if np.isfinite(margin[at]):
                smallest, where = float(margin[at]), (int(at[0]), int(at[1]))
            broken += [(int(i), int(p), float(low[i, p])) for i, p in np.argwhere(margin < -TINY)]
        # Pairs left open by the containing segments; the worst position of each pair comes first.
        for p in (
            np.flatnonzero(np.min(np.where(sure, np.inf, low - need), axis=0) < NEAR) if low.size else ()
        ):
            column = np.where(sure[:, p], np.inf, low[:, p] - need[p])
            examined = np.zeros(len(column), dtype=bool)
            while not examined[i := int(np.argmin(column))] and column[i] <= min(smallest, NEAR):
                apart = self.apart(int(p), R[i], t[i])
                if apart.low - need[p] < smallest:
                    smallest, where = apart.low - need[p], (i, int(p))
                if apart.high < need[p] - TINY:
                    broken.append((i, int(p), apart.high))
                # The plane found here also separates the bodies at most of the other positions.
                column = np.maximum(column, self._room(int(p), R, t, apart.normal) - need[p])
                column[i], examined[i] = apart.low - need[p], True
        return Least(smallest, where, broken)

    # --- one pair -----------------------------------------------------------------------------------------

    def apart(self, pair: int, R: np.ndarray, t: np.ndarray) -> Apart:
        """Bracket the signed distance of one pair with the bodies placed at R (nb, 3, 3), t (nb, 3)."""
        a, b = self.pairs[pair]
        ends: list[tuple[np.ndarray, np.ndarray]] = []
        if self._fcl_distance(a, b, R, t, ends) > 0:
            self._coal_distance(a, b, R, t, ends)
            high = min(
                (float(np.linalg.norm(q - p)) for p, q in ends if self._inside(a, b, R, t, p, q)),
                default=np.inf,
            )
            low = max((self._plane(a, b, R, t, q - p) for p, q in ends), default=-np.inf)
            normal = max((q - p for p, q in ends), key=lambda v: self._plane(a, b, R, t, v))
            normal = normal / max(np.linalg.norm(normal), 1e-12)
            return self._improve(a, b, R, t, normal, low, high)
        return self._deep(a, b, R, t, ends)

    def _deep(self, a, b, R, t, ends) -> Apart:
        """Return the best of many planes; for bodies that overlap, two points prove no upper bound."""
        depth, normal = self._coal_distance(a, b, R, t, ends)
        if depth > 0:
            return Apart(self._plane(a, b, R, t, normal), depth, normal)
        tries = np.array([normal, t[b] - t[a], *R[a].T, *R[b].T, *-R[a].T, *-R[b].T])
        low, n = self._turned(a, b, R, t, tries)
        return Apart(low, low, n)

    def _fcl_distance(self, a, b, R, t, ends) -> float:
        result = fcl.DistanceResult()
        one = fcl.CollisionObject(self._fcl[a], fcl.Transform(R[a], t[a]))
        two = fcl.CollisionObject(self._fcl[b], fcl.Transform(R[b], t[b]))
        d = float(fcl.distance(one, two, fcl.DistanceRequest(enable_nearest_points=True), result))
        if d <= 0:
            return d
        p, q = (np.array(x) for x in result.nearest_points)
        thick = self._thickened(a, b, p, q)
        if d > self.solids[a].round + self.solids[b].round:
            ends.append(thick)
        return d - self.solids[a].round - self.solids[b].round

    def _thickened(self, a, b, p, q) -> tuple[np.ndarray, np.ndarray]:
        """Move the engine's two points toward each other by the radii that the engine's shapes lack."""
        n = (q - p) / max(float(np.linalg.norm(q - p)), 1e-12)
        return p + self.solids[a].round * n, q - self.solids[b].round * n

    def _coal_distance(self, a, b, R, t, ends) -> tuple[float, np.ndarray]:
        result = coal.DistanceResult()
        place = [coal.Transform3s(R[k], t[k]) for k in (a, b)]
        d = coal.distance(self._coal[a], place[0], self._coal[b], place[1], self._request, result)
        p, q = result.getNearestPoint1().copy(), result.getNearestPoint2().copy()
        ends.append(self._thickened(a, b, p, q) if d > 0 else (p, q))
        return float(d) - self.solids[a].round - self.solids[b].round, np.array(result.normal)

    def _inside(self, a, b, R, t, p, q) -> bool:
        """Return True if both points lie in their bodies, so that their distance is an upper bound."""
        return self.solids[a].holds(R[a].T @ (p - t[a]), TINY / 4) and self.solids[b].holds(
            R[b].T @ (q - t[b]), TINY / 4
        )

    def _plane(self, a, b, R, t, v) -> float:
        """Return the width of the gap between the bodies along v: at most their signed distance."""
        length = np.linalg.norm(v)
        if not np.isfinite(length) or length < 1e-12:
            return -np.inf
        n = v / length
        return float(
            n @ (t[b] - t[a]) - self.solids[a].reach(R[a].T @ n) - self.solids[b].reach(-(R[b].T @ n))
        )

    def _room(self, pair: int, R, t, n) -> np.ndarray:
        """Return the same gap for one normal and many positions, R (m, nb, 3, 3) and t (m, nb, 3)."""
        a, b = self.pairs[pair]
        n = n / max(np.linalg.norm(n), 1e-12)
        near = self.solids[a].reaches(n @ R[:, a])
        return (t[:, b] - t[:, a]) @ n - near - self.solids[b].reaches(-(n @ R[:, b])) - 1e-9

    def _improve(self, a, b, R, t, n, low, high) -> Apart:
        """Turn the plane for more room if the engines disagree or leave a gap."""
        if high - low < 1e-6:
            return Apart(low, high, n)
        self.gaps += 1
        better, turned = self._turned(a, b, R, t, np.array([n]))
        return Apart(better, high, turned) if better > low else Apart(low, high, n)

    def _turned(self, a, b, R, t, tries: np.ndarray) -> tuple[float, np.ndarray]:
        """Turn planes, (k, 3), step by step for more room; return the best room and its plane."""
        lengths = np.linalg.norm(tries, axis=1, keepdims=True)
        n = np.where(lengths > 1e-12, tries / np.maximum(lengths, 1e-12), np.array([0.0, 0.0, 1.0]))
        v, step = t[b] - t[a], np.full(len(n), 0.3)

        def room(m: np.ndarray) -> np.ndarray:
            return m @ v - self.solids[a].reaches(m @ R[a]) - self.solids[b].reaches(-(m @ R[b]))

        best = room(n)
        turns = np.concatenate([R[a].T, -R[a].T])
        for _ in range(60):
            if step.max() < 1e-8:  # the remaining gain is of second order in the step
                break
            m = n[:, None, :] + step[:, None, None] * turns
            m = m / np.sqrt(np.einsum("kij,kij->ki", m, m))[:, :, None]
            separations = room(m.reshape(-1, 3)).reshape(len(n), -1)
            k = np.argmax(separations, axis=1)
            gain = separations[np.arange(len(n)), k]
            up = gain > best
            n = np.where(up[:, None], m[np.arange(len(n)), k], n)
            best, step = np.where(up, gain, best), np.where(up, step, step / 2)
        return float(best.max()), n[int(np.argmax(best))]


@dataclass(frozen=True)
class Least:
    """Smallest margin over the need, its position and pair, and all violations (position, pair, m)."""

    margin: float
    where: tuple[int, int] | None
    broken: list[tuple[int, int, float]]


# --- joints -----------------------------------------------------------------------------------------------


def step_faults(
    robot, last: Sequence[float], u: Sequence[float], setpoint: Sequence[float], outside: float = 0.0
) -> Iterable[str]:
    """Return the robot's own bounds that an increment violates: speed, acceleration, deceleration, limits."""
    T, eps = robot.period, 1e-9
    for j, (x0, x, q) in enumerate(zip(last, u, setpoint, strict=True)):
        name = robot.model.joints[j].name
        v, a, d = robot.velocity[j] * T, robot.acceleration[j] * T * T, robot.deceleration[j] * T * T
        if abs(x) > v + eps * v:
            yield f"{name}: increment {x} is above {v}"
        if x * x0 >= 0:
            gain, loss = max(abs(x) - abs(x0), 0.0), max(abs(x0) - abs(x), 0.0)
            if gain > a * (1 + 1e-9) + 1e-12 or loss > d * (1 + 1e-9) + 1e-12:
                yield f"{name}: from {x0} to {x}, acceleration {a}, deceleration {d}"
        elif abs(x0) / d + abs(x) / a > 1 + 1e-6:
            yield f"{name}: through zero from {x0} to {x}, acceleration {a}, deceleration {d}"
        if not robot.lower[j] - outside - 1e-9 <= q <= robot.upper[j] + outside + 1e-9:
            yield f"{name}: setpoint {q} is outside [{robot.lower[j]}, {robot.upper[j]}]"
