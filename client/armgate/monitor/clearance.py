"""Clearances of all pairs of bodies at the poses of the newest states.

Most pairs need no distance query. Each pair keeps a certified lower bound d₀ of its distance at some poses q₀
of its robots. The distance at other poses q is at least d₀ − Σ_j L_j |q_j − q₀_j|, where L are the levers of
``Reach``. If this bound does not suffice, two more steps follow: the last separating plane at the new poses,
which also renews the kept bound; then GJK for each combination of poses.

One plane serves all combinations of poses of two robots at once, because the room that it leaves is a sum of
one term per robot: D = −max h_A(n) − max h_B(−n).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armgate.monitor import tolerances as tol
from armgate.monitor.convex_solid import Solid
from armgate.monitor.distance import ROUNDING, DistanceBounds, PlacedSolid, Vector, distance_bounds
from armgate.monitor.kinematics import Kinematics, Reach, moved_by
from armgate.monitor.model import KINDS, Cell, Kind, Pair
from armgate.monitor.motion import END, MEASURED, SETPOINT
from armgate.monitor.transforms import Array

POSES = 4
CORNERS = 8
RESOLUTION = 1e-4
"""Accuracy of the smallest clearances, m."""

_CANDIDATES = 8
"""Number of pairs with the smallest margins, of which at most one per state gets a new plane in advance."""

_AGE = 64
"""Number of uses of a plane after which a new one may be computed in advance."""


@dataclass(frozen=True)
class ClosePair:
    """Pair of bodies that are close: bounds of the signed distance [m], and the poses of their robots.

    ``lacking`` is the distance by which the upper bound is below the limit minus its tolerance, m.
    """

    pair: int
    low: float
    high: float
    lacking: float
    at: tuple[int, int]


class Clearances:
    """Newest poses of all robots, and the kept bounds and planes of all pairs."""

    def __init__(self, cell: Cell) -> None:
        self.cell = cell
        self._bodies = _Bodies(cell)
        self._kinematics = [Kinematics(robot) for robot in cell.robots]
        self._reaches = self._reach()
        self._rows = [_RobotPairs(cell, r, self._reaches) for r in range(len(cell.robots))]
        pairs = cell.pairs
        self._a = np.array([pair.a for pair in pairs], dtype=np.intp)
        self._b = np.array([pair.b for pair in pairs], dtype=np.intp)
        self.limits = np.array([pair.limit for pair in pairs])
        self._kinds = np.array([KINDS.index(pair.kind) for pair in pairs], dtype=np.intp)
        self._self = np.array([pair.kind == "self" for pair in pairs], dtype=bool)
        self._bound = np.full(len(pairs), -np.inf)
        self._used = np.zeros((len(pairs), 2))
        self._normal = np.zeros((len(pairs), 3))
        self._age = np.full(len(pairs), _AGE)
        self._poses: list[Array | None] = [None] * len(cell.robots)
        self._frames: list[Array | None] = [None] * len(cell.robots)
        self._fresh = [POSES] * len(cell.robots)
        self._complete = False
        self._measuring = True
        self._pair_of = {frozenset((pair.a, pair.b)): i for i, pair in enumerate(pairs)}
        self.least: dict[Kind, ClosePair] = {}

    def _reach(self) -> list[Reach]:
        bodies = self.cell.bodies
        return [
            Reach(robot, [body for body in bodies if body.robot == r])
            for r, robot in enumerate(self.cell.robots)
        ]

    # --- poses from states ---------------------------------------------------------------------------------

    def set_poses(self, robot: int, poses: Array) -> None:
        """Set the poses (4, n) of a robot."""
        known = self._poses[robot]
        if known is not None and np.array_equal(known, poses):
            self._fresh[robot] = POSES
            return
        if not self._reaches[robot].covers(poses):
            self._reaches[robot].extend(poses)
            self._rows[robot] = _RobotPairs(self.cell, robot, self._reaches)
            self._bound[self._rows[robot].pairs] = -np.inf
        self._poses[robot], self._frames[robot], self._fresh[robot] = poses, None, POSES
        self._complete = all(known is not None for known in self._poses)
        rows = self._rows[robot]
        self._used[rows.pairs, rows.side] = rows.used(poses)

    def forget_stop_ends(self, robot: int) -> None:
        """Forget the stop ends of a robot, which may have another plan by now."""
        self._fresh[robot] = END

    def has_poses(self, robot: int) -> bool:
        """Return True if the poses of a robot are known."""
        return self._poses[robot] is not None

    def forget(self, robot: int) -> None:
        """Forget the poses of a robot, whose states are missing."""
        self._poses[robot], self._complete = None, False

    # --- the cascade --------------------------------------------------------------------------------------

    def check(self, robot: int, *, measure: bool) -> list[ClosePair]:
        """Return the pairs of a robot that are not proven to keep their limit, at their worst poses.

        Args:
            robot: Its index.
            measure: True to find the smallest clearances as well.
        """
        self._measuring = measure
        pairs = self._rows[robot].pairs
        if not self._complete:
            pairs = pairs[self._known(pairs)]
        need = self._need(pairs)
        pairs = pairs[self._bound[pairs] - self._used[pairs].sum(axis=1) < need]
        if not len(pairs):
            return []
        rooms = self._planes(pairs)
        self._renew_plane(pairs, rooms - self._need(pairs))
        found = []
        for k in np.argsort(rooms).tolist():
            pair = int(pairs[k])
            if rooms[k] < self._need(pairs[k : k + 1])[0]:
                found.append(self._worst_combination(pair))
        return found

    def at_measured(self, first: int, second: int) -> DistanceBounds:
        """Return the distance of two bodies, by index, at the measured positions."""
        a, b = (self._bodies.placed(self._frame_of, body, MEASURED) for body in (first, second))
        return distance_bounds(a, b)

    def pair_of(self, first: int, second: int) -> int | None:
        """Return the pair of two bodies; None if no distance is required between them."""
        return self._pair_of.get(frozenset((first, second)))

    def lever(self, pair: int, robot: int) -> float:
        """Return how far a measurement error of a robot can change the distance of a pair, m."""
        rows = self._rows[robot]
        where = np.flatnonzero(rows.pairs == pair)
        return 0.0 if not len(where) else float(rows.levers[where[0]].sum()) * self._tolerance(robot)

    def _tolerance(self, robot: int) -> float:
        return self.cell.robots[robot].q_tolerance

    def _known(self, pairs: NDArray[np.intp]) -> NDArray[np.bool_]:
        known = np.array([poses is not None for poses in self._poses] + [True])
        return np.asarray(
            known[self._bodies.robot[self._a[pairs]]] & known[self._bodies.robot[self._b[pairs]]]
        )

    def _need(self, pairs: NDArray[np.intp]) -> Array:
        """Return the sufficient bound of each pair: its limit, or the smallest clearance so far if larger."""
        need = self.limits[pairs] - tol.CLEARANCE / 2.0
        if not self._measuring:
            return np.asarray(need)
        least = np.array(
            [self.least[kind].low - RESOLUTION if kind in self.least else np.inf for kind in KINDS]
        )
        return np.asarray(np.maximum(need, least[self._kinds[pairs]]))

    def _planes(self, pairs: NDArray[np.intp]) -> Array:
        """Evaluate the kept planes: renew the kept bounds, return the room over all poses (k,), m."""
        near, far = self._heights(pairs)
        own = self._self[pairs]
        rooms = np.where(own, (-near - far).min(axis=0), -near.max(axis=0) - far.max(axis=0)) - ROUNDING
        self._keep(pairs, -near[SETPOINT] - far[SETPOINT] - ROUNDING)
        self._age[pairs] += 1
        return np.asarray(rooms)

    def _heights(self, pairs: NDArray[np.intp]) -> tuple[Array, Array]:
        """Return the heights of both bodies along the kept planes' normals, at all poses, (4, k) each, m."""
        A = self._bodies.places(self._frame_of, self._a[pairs])
        B = self._bodies.places(self._frame_of, self._b[pairs])
        new = ~self._normal[pairs].any(axis=1)
        if new.any():
            self._set_first_normals(pairs[new], A[SETPOINT][new], B[SETPOINT][new])
        normals = self._world_normals(pairs)
        near = self._bodies.heights(self._a[pairs], A, normals)
        return near, self._bodies.heights(self._b[pairs], B, -normals)

    def _keep(self, pairs: NDArray[np.intp], bounds: Array) -> None:
        """Keep lower bounds (k,) that hold at the setpoints."""
        self._bound[pairs] = bounds
        for robot, poses in enumerate(self._poses):
            if poses is not None:
                self._rows[robot].keep(pairs, poses, self._used)

    def _set_first_normals(self, pairs: NDArray[np.intp], A: Array, B: Array) -> None:
        """Set the first normals: the directions from the middle of one body to that of the other."""
        middles = [self._bodies.middles(self._a[pairs], A), self._bodies.middles(self._b[pairs], B)]
        n = middles[1] - middles[0]
        n = n / np.maximum(np.linalg.norm(n, axis=1, keepdims=True), 1e-9)
        n[~n.any(axis=1)] = (0.0, 0.0, 1.0)
        for pair, normal in zip(pairs.tolist(), n, strict=True):
            self._set_normal(pair, normal)

    def _set_normal(self, pair: int, world: Array | Vector) -> None:
        """Keep the normal of a plane; for a pair on one robot in the frame of the first body's joint."""
        n = np.asarray(world)
        if self._self[pair]:
            n = self._bodies.joint_frame(self._frame_of, int(self._a[pair]), SETPOINT)[:3, :3].T @ n
        self._normal[pair] = n / np.linalg.norm(n)

    def _world_normals(self, pairs: NDArray[np.intp]) -> Array:
        """Return the normals of the planes at all poses, (4, k, 3)."""
        normals = np.broadcast_to(self._normal[pairs], (POSES, len(pairs), 3))
        own = self._self[pairs]
        if own.any():
            normals = normals.copy()
            R = self._bodies.joint_frames(self._frame_of, self._a[pairs[own]])[..., :3, :3]
            normals[:, own] = np.einsum("mkij,kj->mki", R, self._normal[pairs[own]])
        return normals

    def _renew_plane(self, pairs: NDArray[np.intp], spare: Array) -> None:
        """Compute a new plane for one of the pairs with the smallest margins, if its plane is old."""
        for k in np.argsort(spare)[:_CANDIDATES]:
            pair = int(pairs[k])
            if self._age[pair] >= _AGE and spare[k] > 0.0:
                self._measure_distance(pair, SETPOINT, SETPOINT, float(self.limits[pair]))
                break

    def _measure_distance(self, pair: int, pose_a: int, pose_b: int, enough: float) -> DistanceBounds:
        a = self._bodies.placed(self._frame_of, int(self._a[pair]), pose_a)
        b = self._bodies.placed(self._frame_of, int(self._b[pair]), pose_b)
        found = distance_bounds(a, b, enough)
        self._set_normal(pair, found.normal)
        self._age[pair] = 0
        return found

    def _worst_combination(self, pair: int) -> ClosePair:
        """Return the distance of a pair at its worst combination of poses."""
        one = np.array([pair])
        need = float(self._need(one)[0])
        first = self._measure_distance(pair, SETPOINT, SETPOINT, need)
        self._note_smallest(pair, first, (SETPOINT, SETPOINT))
        need = float(self._need(one)[0])
        near, far = self._heights(one)
        worst = self._close_pair(pair, first, (SETPOINT, SETPOINT))
        for i, j in self._combinations(pair):
            if (i, j) == (SETPOINT, SETPOINT) or -near[i, 0] - far[j, 0] - ROUNDING >= need:
                continue
            found = self._measure_distance(pair, i, j, need)
            self._note_smallest(pair, found, (i, j))
            close = self._close_pair(pair, found, (i, j))
            worst = max(worst, close, key=lambda one: one.lacking)
        return worst

    def _close_pair(self, pair: int, found: DistanceBounds, at: tuple[int, int]) -> ClosePair:
        lacking = float(self.limits[pair]) - self._slack(pair, at) - found.high
        return ClosePair(pair, found.low, found.high, lacking, at)

    def _note_smallest(self, pair: int, found: DistanceBounds, at: tuple[int, int]) -> None:
        """Note a distance if it is the smallest of its kind."""
        kind = self.cell.pairs[pair].kind
        if kind not in self.least or found.low < self.least[kind].low:
            self.least[kind] = ClosePair(pair, found.low, found.high, 0.0, at)

    def _combinations(self, pair: int) -> list[tuple[int, int]]:
        """Return the combinations of different poses that both bodies can have at the same time."""
        ra, rb = (self.cell.bodies[i].robot for i in (int(self._a[pair]), int(self._b[pair])))
        of_a = [SETPOINT] if ra is None else self._different(ra)
        if self._self[pair]:
            return [(i, i) for i in of_a]
        of_b = [SETPOINT] if rb is None else self._different(rb)
        return [(i, j) for i in of_a for j in of_b]

    def _different(self, robot: int) -> list[int]:
        poses = self._poses[robot]
        assert poses is not None
        kept: list[int] = []
        for i in (SETPOINT, MEASURED, END, END + 1):
            if i < self._fresh[robot] and not any(np.abs(poses[i] - poses[k]).max() <= 1e-12 for k in kept):
                kept.append(i)
        return kept

    def _slack(self, pair: int, at: tuple[int, int]) -> float:
        """Return the tolerance of a clearance: that of the monitor plus that of measured positions."""
        slack = tol.CLEARANCE
        for body, pose in zip((int(self._a[pair]), int(self._b[pair])), at, strict=True):
            robot = self.cell.bodies[body].robot
            if robot is not None and pose == MEASURED:
                slack += self.lever(pair, robot)
        return slack

    def _frame_of(self, robot: int) -> Array:
        """Return the joint frames of a robot at its poses."""
        frames, poses = self._frames[robot], self._poses[robot]
        assert poses is not None
        if frames is None:
            frames = self._frames[robot] = self._kinematics[robot].frames(poses)
        return frames


class _RobotPairs:
    """Pairs of one robot: the levers of its joints, and the positions for which their bounds are kept."""

    def __init__(self, cell: Cell, robot: int, reaches: Sequence[Reach]) -> None:
        own = [i for i, body in enumerate(cell.bodies) if body.robot == robot]
        row_of = {body: row for row, body in enumerate(own)}
        moved = moved_by(cell.robots[robot], [cell.bodies[i] for i in own])
        lever = reaches[robot].lever
        pairs, sides, levers = [], [], []
        for index, pair in enumerate(cell.pairs):
            inside = [row_of[body] for body in (pair.a, pair.b) if body in row_of]
            if len(inside) == 2:
                first, second = inside
                relative = moved[first] ^ moved[second]  # joints that move both bodies do not change the pair
                row = np.where(relative, np.maximum(lever[first], lever[second]), 0.0)
            elif inside:
                row = lever[inside[0]]
            else:
                continue
            pairs.append(index)
            sides.append(0 if pair.a in row_of else 1)
            levers.append(row)
        n = cell.robots[robot].n
        self.pairs = np.array(pairs, dtype=np.intp)
        self.side = np.array(sides, dtype=np.intp)
        self.levers = np.array(levers).reshape(-1, n)
        self._kept = np.zeros_like(self.levers)
        self._where = np.full(len(cell.pairs), -1, dtype=np.intp)
        self._where[self.pairs] = np.arange(len(self.pairs))

    def used(self, poses: Array) -> Array:
        """Return how much of each pair's bound may be used up at any of the poses (m, n), (k,), m."""
        return self._used(slice(None), poses)

    def _used(self, rows: slice | NDArray[np.intp], poses: Array) -> Array:
        # The maximum of each joint over the poses: slightly more than for any one pose, and much faster.
        kept = self._kept[rows]
        away = np.maximum(poses.max(axis=0) - kept, kept - poses.min(axis=0))
        return np.asarray(np.einsum("kn,kn->k", away, self.levers[rows]))

    def keep(self, pairs: NDArray[np.intp], poses: Array, used: Array) -> None:
        """Keep the bounds of some pairs for the setpoint, and update how much of them is used up."""
        rows = self._where[pairs]
        rows = rows[rows >= 0]
        self._kept[rows] = poses[SETPOINT]
        used[self.pairs[rows], self.side[rows]] = self._used(rows, poses)


class _Bodies:
    """All bodies as arrays, to evaluate planes against many bodies at once."""

    def __init__(self, cell: Cell) -> None:
        self._cell = cell
        solids = [body.solid for body in cell.bodies]
        self._points = np.array([_padded(solid) for solid in solids])
        self._discs = np.array([_padded_discs(solid) for solid in solids])
        self._radius = np.array([solid.radius for solid in solids])
        self._place = np.array([body.placement for body in cell.bodies])
        self._middle = np.array([solid.middle for solid in solids])
        world = len(cell.robots)
        self.robot = np.array([world if b.robot is None else b.robot for b in cell.bodies], dtype=np.intp)
        self._joint = np.array([body.joint for body in cell.bodies], dtype=np.intp)

    def joint_frames(self, frame_of, bodies: NDArray[np.intp]) -> Array:  # type: ignore[no-untyped-def]
        """Return the frames of the joints of bodies at all poses, (4, k, 4, 4)."""
        frames = np.empty((POSES, len(bodies), 4, 4))
        robots = self.robot[bodies]
        for robot in np.unique(robots).tolist():
            rows = robots == robot
            if robot < len(self._cell.robots):
                frames[:, rows] = frame_of(robot)[:, self._joint[bodies[rows]]]
            else:
                frames[:, rows] = np.eye(4)
        return frames

    def places(self, frame_of, bodies: NDArray[np.intp]) -> Array:  # type: ignore[no-untyped-def]
        """Return the placements of bodies at all poses, (4, k, 4, 4)."""
        return np.asarray(self.joint_frames(frame_of, bodies) @ self._place[bodies])

    def heights(self, bodies: NDArray[np.intp], places: Array, normals: Array) -> Array:
        """Return the support function of bodies along unit normals (4, k, 3), from the origin, (4, k)."""
        d = np.einsum("mkji,mkj->mki", places[..., :3, :3], normals)
        far = np.einsum("mki,kpi->mkp", d, self._points[bodies])
        far += self._discs[bodies] * np.hypot(d[..., 0], d[..., 1])[..., None]
        origin = np.einsum("mki,mki->mk", places[..., :3, 3], normals)
        return np.asarray(far.max(axis=2) + origin + self._radius[bodies])

    def middles(self, bodies: NDArray[np.intp], places: Array) -> Array:
        """Return the middles of bodies at placements (k, 4, 4), (k, 3), m."""
        return np.asarray(np.einsum("kij,kj->ki", places[:, :3, :3], self._middle[bodies]) + places[:, :3, 3])

    def joint_frame(self, frame_of, body: int, pose: int) -> Array:  # type: ignore[no-untyped-def]
        """Return the frame of the joint of one body at one pose, (4, 4)."""
        robot = self._cell.bodies[body].robot
        return np.eye(4) if robot is None else np.asarray(frame_of(robot)[pose, self._joint[body]])

    def placed(self, frame_of, body: int, pose: int) -> PlacedSolid:  # type: ignore[no-untyped-def]
        """Return one body at one pose."""
        return PlacedSolid(
            self._cell.bodies[body].solid, self.joint_frame(frame_of, body, pose) @ self._place[body]
        )


def _padded(solid: Solid) -> Array:
    points = np.repeat(solid.points[:1], CORNERS, axis=0)
    points[: len(solid.points)] = solid.points
    return points


def _padded_discs(solid: Solid) -> Array:
    discs = np.repeat(solid.discs[:1], CORNERS)
    discs[: len(solid.discs)] = solid.discs
    return discs


def pair_names(cell: Cell, pair: Pair) -> tuple[str, str]:
    """Return the names of the bodies of a pair."""
    return cell.bodies[pair.a].name, cell.bodies[pair.b].name
