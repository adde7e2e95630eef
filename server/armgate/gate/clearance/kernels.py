"""Kinematics and slabs compiled by numba: the same formulas as in the numpy modules, as loops.

Each kernel names the numpy function that it repeats; that function explains the formula and names the kernel.
`tests/gate/test_prefilter.py` compares the two forms. All kernels are in one file, because numba's cache
checks only the file of the function that it compiled: a change in this file compiles everything anew.
"""

from __future__ import annotations

from math import cos, sin, sqrt

import numpy as np

from armgate.cell.compilation import kernel

# Records for joints, bodies and pairs in any number: one compilation serves all cells.
JOINT = np.dtype(
    [("R", "f8", (3, 3)), ("t", "f8", (3,)), ("axis", "f8", (3,)), ("slides", "i8"), ("parent", "i8")]
)
ROBOT = np.dtype([("joint", "i8"), ("joints", "i8"), ("body", "i8"), ("bodies", "i8")])
BODY = np.dtype(
    [
        ("R", "f8", (3, 3)),
        ("t", "f8", (3,)),
        ("joint", "i8"),
        ("owner", "i8"),
        ("row", "f8", (5,)),
        ("corners", "i8"),
    ]
)
PAIR = np.dtype([("mine", "i8"), ("theirs", "i8")])

_GAP = 1e-4
"""`certificate.GAP`: difference between bound and distance above which the second engine is queried, m."""

_TIGHT = 5e-6
"""`certificate.TIGHT`: largest difference for which no engine is queried, m."""

_TOUCHING = 1e-9
"""`engines.TOUCHING`: distance up to which the witness points give no direction, m."""


@kernel
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def _larger(a, b):
    """`np.maximum`: NaN if one argument is NaN; the built-in ``max`` would lose it."""
    return a if a >= b or np.isnan(a) else b


@kernel
def _turned(R, v):
    """Return R v."""
    return (
        R[0, 0] * v[0] + R[0, 1] * v[1] + R[0, 2] * v[2],
        R[1, 0] * v[0] + R[1, 1] * v[1] + R[1, 2] * v[2],
        R[2, 0] * v[0] + R[2, 1] * v[1] + R[2, 2] * v[2],
    )


@kernel
def _turned_back(R, v):
    """Return Rᵀ v."""
    return (
        R[0, 0] * v[0] + R[1, 0] * v[1] + R[2, 0] * v[2],
        R[0, 1] * v[0] + R[1, 1] * v[1] + R[2, 1] * v[2],
        R[0, 2] * v[0] + R[1, 2] * v[1] + R[2, 2] * v[2],
    )


@kernel
def _product(A, B, out):
    for i in range(3):
        for j in range(3):
            out[i, j] = A[i, 0] * B[0, j] + A[i, 1] * B[1, j] + A[i, 2] * B[2, j]


@kernel
def _about(axis, angle, out):
    """Write Rodrigues' rotation matrix to ``out``."""
    c, s = cos(angle), sin(angle)
    x, y, z = axis[0], axis[1], axis[2]
    d = 1.0 - c
    out[0, 0], out[0, 1], out[0, 2] = c + d * x * x, d * x * y - s * z, d * x * z + s * y
    out[1, 0], out[1, 1], out[1, 2] = d * x * y + s * z, c + d * y * y, d * y * z - s * x
    out[2, 0], out[2, 1], out[2, 2] = d * x * z - s * y, d * y * z + s * x, c + d * z * z


@kernel
def _moved(R, t, v, out):
    """Write R v + t to ``out``."""
    x, y, z = _turned(R, v)
    out[0], out[1], out[2] = t[0] + x, t[1] + y, t[2] + z


@kernel
def _place_joints(joints, q, R, t):
    here, turn = np.empty((3, 3)), np.empty((3, 3))
    for i in range(len(joints)):
        joint = joints[i]
        if joint.parent < 0:
            here[:] = joint.R
            t[i] = joint.t
        else:
            _product(R[joint.parent], joint.R, here)
            _moved(R[joint.parent], t[joint.parent], joint.t, t[i])
        if joint.slides:
            a = _turned(here, joint.axis)
            R[i] = here
            for c in range(3):
                t[i, c] += q[i] * a[c]
        else:
            _about(joint.axis, q[i], turn)
            _product(here, turn, R[i])


@kernel
def place(cell, robot, q, R, t):
    """`RobotModel.body_placements`: write to R (nb, 3, 3) and t (nb, 3)."""
    own = cell[0][robot]
    joints = cell[1][own.joint : own.joint + own.joints]
    bodies = cell[2][own.body : own.body + own.bodies]
    jR, jt = np.empty((len(joints), 3, 3)), np.empty((len(joints), 3))
    _place_joints(joints, q, jR, jt)
    for b in range(len(bodies)):
        body = bodies[b]
        if body.joint < 0:
            R[b] = body.R
            t[b] = body.t
        else:
            _product(jR[body.joint], body.R, R[b])
            _moved(jR[body.joint], jt[body.joint], body.t, t[b])


@kernel
def _chord_deviation(nodes, bend):
    """`swept.chord_deviation` of one body or pair: the largest Σ_ij |δ_i||δ_j| G_ij / 8 of the segments."""
    most = 0.0
    for s in range(len(nodes) - 1):
        total = 0.0
        for i in range(nodes.shape[1]):
            way = abs(nodes[s + 1, i] - nodes[s, i])
            if way > 0.0:
                for j in range(nodes.shape[1]):
                    total += way * bend[i, j] * abs(nodes[s + 1, j] - nodes[s, j])
        most = _larger(most, total)
    return most / 8.0


@kernel
def _sweep(cell, robot, nodes, tube, out):
    """`Swept.placements` (m, nb, …) and `Swept.deviation` (m, nb), the same at every node."""
    R, t, deviation = out
    own = cell[0][robot]
    motion, bend = cell[4], cell[5]
    for m in range(len(nodes)):
        place(cell, robot, nodes[m], R[m], t[m])
    for b in range(own.bodies):
        far = _chord_deviation(nodes, bend[own.body + b])
        for j in range(len(tube)):
            far += motion[own.body + b, j] * tube[j]
        for m in range(len(nodes)):
            deviation[m, b] = far


@kernel
def hold(cell, held, robot, row, nodes, tube):
    """`prefilter._Table._write`: write a robot's held occupancy to the table's rows from ``row`` on."""
    own = cell[0][robot]
    R, t, deviation, _ = held
    rows, mine = slice(row, row + len(nodes)), slice(own.body, own.body + own.bodies)
    _sweep(cell, robot, nodes, tube, (R[rows, mine], t[rows, mine], deviation[rows, mine]))


@kernel
def _support(cell, body, v):
    """`support.support` of one body in the direction v (3,)."""
    row = body.row
    x, y = abs(v[0]), abs(v[1])
    level = sqrt(x * x + y * y)
    h = row[0] * x + row[1] * y + row[2] * abs(v[2]) + row[3] * level + row[4]
    if body.corners >= 0:
        corners = cell[3][body.corners]
        most = -np.inf
        for k in range(len(corners)):
            p = corners[k]
            most = _larger(most, p[0] * v[0] + p[1] * v[1] + p[2] * v[2] + p[3] * level)
        h += most
    return h


@kernel
def _reach(cell, body, n, R, t, deviation):
    """`Swept.reach` and `prefilter._Table._reach`: largest n·x over all nodes of one body; ∞ without nodes.

    R is (m, 3, 3), t (m, 3) and deviation (m,).
    """
    if len(t) == 0:
        return np.inf
    most = -np.inf
    for m in range(len(t)):
        most = _larger(most, _support(cell, body, _turned_back(R[m], n)) + _dot(t[m], n) + deviation[m])
    return most


@kernel
def _chained(cell, pair, n, R, t):
    """`ChainGroup.slab` without the deviation; R and t of the bodies of the robot."""
    first = cell[0][cell[2][pair.mine].owner].body
    base, tip = pair.mine - first, pair.theirs - first
    most = -np.inf
    for m in range(len(t)):
        w = _turned(R[m, base], n)
        away = (-w[0], -w[1], -w[2])
        apart = (t[m, tip, 0] - t[m, base, 0], t[m, tip, 1] - t[m, base, 1], t[m, tip, 2] - t[m, base, 2])
        far = _support(cell, cell[2][pair.theirs], _turned_back(R[m, tip], away)) - _dot(apart, w)
        most = _larger(most, far)
    return -_support(cell, cell[2][pair.mine], n) - most


@kernel
def _apart(cell, held, pair, n, new):
    """`Group.slab` of one pair whose sides move independently; ``new`` is the occupancy of its robot."""
    robots, bodies = cell[0], cell[2]
    R, t, deviation = new
    mine, theirs = bodies[pair.mine], bodies[pair.theirs]
    k = pair.mine - robots[mine.owner].body
    near = _reach(cell, mine, n, R[:, k], t[:, k], deviation[:, k])
    away = (-n[0], -n[1], -n[2])
    if theirs.owner == mine.owner:
        k = pair.theirs - robots[mine.owner].body
        return -near - _reach(cell, theirs, away, R[:, k], t[:, k], deviation[:, k])
    hR, ht, hdeviation, count = held
    rows, k = count[theirs.owner], pair.theirs
    return -near - _reach(cell, theirs, away, hR[:rows, k], ht[:rows, k], hdeviation[:rows, k])


@kernel
def slabs(cell, held, own, moves, asked, lb):
    """`Prefilter._slabs`: fill ``lb``, (P,), and return −1.

    If the held occupancies of robot k are needed and the table is out of date there (its count is −1),
    return k.
    """
    pairs, growth, chain_bend = own
    robot, nodes, tube = moves
    left, n = asked
    for p in left:
        other = cell[2][pairs[p].theirs].owner
        if other != robot and held[3][other] < 0:
            return other
    number = cell[0][robot].bodies
    R, t = np.empty((len(nodes), number, 3, 3)), np.empty((len(nodes), number, 3))
    deviation = np.empty((len(nodes), number))
    _sweep(cell, robot, nodes, tube, (R, t, deviation))
    for i in range(len(left)):
        p = left[i]
        if p < len(chain_bend):
            lb[i] = _chained(cell, pairs[p], n[i], R, t) - _chord_deviation(nodes, chain_bend[p])
            for j in range(len(tube)):
                lb[i] -= growth[p, j] * tube[j]
        else:
            lb[i] = _apart(cell, held, pairs[p], n[i], (R, t, deviation))
    return -1


@kernel
def follow(cell, robot, moved, pairs, margin, poses):
    """`NearestPairs._move`: place a robot's bodies at q, and lower its margins by the motion from ``before``.

    Poses, R (b, 3, 3) and t (b, 3), are those of all bodies of the cell, margins those of all its pairs.
    """
    q, before = moved
    ids, growth = pairs
    own = cell[0][robot]
    mine = slice(own.body, own.body + own.bodies)
    place(cell, robot, q, poses[0][mine], poses[1][mine])
    step = np.empty(len(q))
    for j in range(len(q)):
        step[j] = abs(q[j] - before[j])
    for k in range(len(ids)):
        way = 0.0
        for j in range(len(q)):
            way += growth[k, j] * step[j]
        margin[ids[k]] -= way


@kernel
def lower(growth, step, need, bound, lb, left):
    """`Prefilter._lowered`: fill ``lb`` (P,) and the first places of ``left`` (P,); return their number."""
    count = 0
    for k in range(len(lb)):
        loss = 0.0
        for j in range(len(step)):
            loss += growth[k, j] * step[j]
        lb[k] = bound[k] - loss
        if not lb[k] >= need[k]:
            left[count] = k
            count += 1
    return count


@kernel
def _lowest(margin, places):
    """`np.argmin` among ``places``: the first NaN, else the first lowest value; −1 if it is not finite."""
    best = -1
    for k in places:
        if best < 0 or margin[k] < margin[best] or (np.isnan(margin[k]) and not np.isnan(margin[best])):
            best = k
    return best if best >= 0 and np.isfinite(margin[best]) else -1


@kernel
def stale(margin, others, tight):
    """Return the first of `NearestPairs._lowest` that is not marked in ``tight``, (P,); −1 if all are."""
    k = _lowest(margin, range(len(margin)))
    if k >= 0 and not tight[k]:
        return k
    k = _lowest(margin, others)
    return k if k >= 0 and not tight[k] else -1


@kernel
def _slab_between(cell, poses, a, b, v):
    """`certificate._slab` of the bodies a and b along v."""
    R, t, bodies = poses[0], poses[1], cell[2]
    apart = (t[b, 0] - t[a, 0], t[b, 1] - t[a, 1], t[b, 2] - t[a, 2])
    away = _turned_back(R[b], (-v[0], -v[1], -v[2]))
    near = _support(cell, bodies[a], _turned_back(R[a], v))
    return _dot(v, apart) - near - _support(cell, bodies[b], away)


@kernel
def _keep(poses, pair, v, out):
    """Write a direction from mine to theirs to ``out``, (3,), as `Clearance.keep_n`.

    It is in the frame of the first body for a pair of one chain, and from second to first body for a reversed
    pair.
    """
    a, _, chained, reversed_ = pair
    n, sign = _turned_back(poses[0][a], v) if chained else v, -1.0 if reversed_ else 1.0
    for i in range(3):
        out[i] = sign * n[i]


@kernel
def _placed_witness(poses, body, local):
    x, y, z = _turned(poses[0][body], local)
    return poses[1][body, 0] + x, poses[1][body, 1] + y, poses[1][body, 2] + z


@kernel
def _recalled(cell, poses, pair, witness, kept):
    """`Certifier.recall` of one pair: return its bound and keep the direction; NaN if no bound is tight."""
    a, b, _, reversed_ = pair
    p = _placed_witness(poses, a, witness[1 if reversed_ else 0])
    q = _placed_witness(poses, b, witness[0 if reversed_ else 1])
    v = (q[0] - p[0], q[1] - p[1], q[2] - p[2])
    distance = sqrt(_dot(v, v))
    if not distance > _TOUCHING:
        return np.nan
    n = (v[0] / distance, v[1] / distance, v[2] / distance)
    lb = _slab_between(cell, poses, a, b, n)
    if not (lb >= 0.0 and abs(distance - lb) <= _TIGHT):
        return np.nan
    _keep(poses, pair, n, kept)
    return lb


@kernel
def _first(margin, out):
    """`nearest_pairs._first`, of finite margins: write the places to ``out``; return their number."""
    found = 0
    for k in range(len(margin)):
        at = found
        while at > 0 and margin[k] < margin[out[at - 1]]:
            at -= 1
        if at < len(out) and np.isfinite(margin[k]):
            found = min(found + 1, len(out))
            for i in range(found - 1, at, -1):
                out[i] = out[i - 1]
            out[at] = k
    return found


@kernel
def _witness_points(poses, pair, witness, reversed_, out):
    """Write the witness points of a pair in the world to ``out``, (6,), in the order of its bodies."""
    first, second = (pair.theirs, pair.mine) if reversed_ else (pair.mine, pair.theirs)
    out[0], out[1], out[2] = _placed_witness(poses, first, witness[0])
    out[3], out[4], out[5] = _placed_witness(poses, second, witness[1])


@kernel
def end(scene, own, kept, search, found):
    """End a search: store its margins; write what `NearestPairs._shown` returns and return the number.

    ``found`` are the margins of all pairs, and, (count + 2,): places, their margins, marks of those that were
    measured, and the witness points of these, (count + 2, 6).
    """
    poses, (pairs, ids, signs, _) = scene[1], own
    margin, tight, _, others = search
    all_margins, shown, margins, measured, points = found
    for k in range(len(ids)):
        all_margins[ids[k]] = margin[k]
    number = _first(margin, shown[: len(shown) - 2])
    for k in (_lowest(margin, range(len(margin))), _lowest(margin, others)):
        known = k < 0
        for i in range(number):
            known = known or shown[i] == k
        if not known:
            shown[number] = k
            number += 1
    for i in range(number):
        k = shown[i]
        margins[i], measured[i] = margin[k], tight[k]
        if tight[k]:
            _witness_points(poses, pairs[k], kept[1][ids[k]], signs[k] < 0.0, points[i])
    return number


@kernel
def recall(scene, own, kept, search, found):
    """`NearestPairs._recall` of one stale pair after the other, as long as their witness points suffice.

    Returns:
        The place of the first pair that an engine must measure; −1 if no pair is stale. Then the search is
        over: the second result is that of `end`.
    """
    cell, poses = scene
    pairs, ids, signs, chained = own
    directions, witnesses = kept
    margin, tight, limits, others = search
    place = stale(margin, others, tight)
    while place >= 0:
        k = ids[place]
        pair = (pairs[place].mine, pairs[place].theirs, place < chained, signs[place] < 0.0)
        lb = _recalled(cell, poses, pair, witnesses[k], directions[k])
        if np.isnan(lb):
            return place, 0
        margin[place] = lb - limits[place]
        tight[place] = True
        place = stale(margin, others, tight)
    return place, end(scene, own, kept, search, found)


@kernel
def begin(scene, own, kept, search, found):
    """Begin a search: fill its margins, (P,), mark none of them as tight, (P,), and `recall`."""
    margin, tight, _, _ = search
    for k in range(len(margin)):
        margin[k] = found[0][own[1][k]]
        tight[k] = False
    return recall(scene, own, kept, search, found)


@kernel
def _unit(v):
    """`engines._direction`: v/|v|, or z for a vector without a direction."""
    length = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    if not np.isfinite(length) or length < _TOUCHING:
        return 0.0, 0.0, 1.0
    return v[0] / length, v[1] / length, v[2] / length


@kernel
def _keep_witness(poses, body, x, radius, v, out):
    """Write the point x, moved along v by the radius, to ``out``, (3,), in the frame of the body."""
    t = poses[1][body]
    moved = (x[0] + radius * v[0] - t[0], x[1] + radius * v[1] - t[1], x[2] + radius * v[2] - t[2])
    out[0], out[1], out[2] = _turned_back(poses[0][body], moved)


@kernel
def certify(scene, own, kept, search, found, measured):
    """`Certifier._best` for the pair at a place: measure its margin; return True if that succeeded.

    The bound of the engine's direction is accepted if the bodies are apart and the bound differs from the
    engine's distance by at most ``_GAP``. Then the witness points are moved to the surfaces, and kept with
    the direction. The other results are those of `recall`. ``measured`` are the place, the radii of all
    bodies, and the engine's distance, witness points and normal.
    """
    cell, poses = scene
    place, radii, distance, p, q, normal = measured
    pairs, ids, signs, chained = own
    pair = (pairs[place].mine, pairs[place].theirs, place < chained, signs[place] < 0.0)
    a, b, _, reversed_ = pair
    near, far = radii[a], radii[b]
    v = (q[0] - p[0], q[1] - p[1], q[2] - p[2])
    if not distance > _TOUCHING:
        v = (normal[0], normal[1], normal[2])
    v = _unit(v)
    lb = _slab_between(cell, poses, a, b, v)
    if not (lb >= 0.0 and abs(distance - near - far - lb) <= _GAP):
        return False, place, 0
    witness, i = kept[1][ids[place]], 1 if reversed_ else 0
    _keep_witness(poses, a, p, near, v, witness[i])
    _keep_witness(poses, b, q, -far, v, witness[1 - i])
    _keep(poses, pair, v, kept[0][ids[place]])
    margin, tight, limits, _ = search
    margin[place] = lb - limits[place]
    tight[place] = True
    return True, *recall(scene, own, kept, search, found)
