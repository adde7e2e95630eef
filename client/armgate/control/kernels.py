"""Kernels of the camera law for numba: the formulas of the numpy modules, in loops.

Each kernel names the function that it repeats, whose docstring explains the formulas. `compiled.py` calls the
kernels, and tests/control/test_compiled.py compares both forms. All kernels are in one file because numba's
cache tracks only the file of the function that it compiled: a change in here causes a new compilation.
"""

from __future__ import annotations

from math import asin, atan, atan2, cos, floor, hypot, pi, sin, sqrt, tan

import numpy as np

from armgate.cell.compilation import kernel
from armgate.control import shaping, view_keeping
from armgate.control.chase import SHORT, SOON
from armgate.control.gradient import DAMPING
from armgate.control.law import INDUCED_DAMPING
from armgate.control.stereographic import ANTIPODE_GUARD, LENS_GUARD

# One record per joint, sphere or obstacle, in any number: one compilation serves all robots. All records are
# passed as one array of bytes, because numba inspects every array of a call: seven arrays took longer than f
# itself. The head holds the offset of each kind; they follow in this order.
KINDS = ("cameras", "goals", "joints", "rows", "spheres", "pairs", "obstacles", "end")
HEAD = np.dtype([(kind, "i8") for kind in KINDS])
JOINT = np.dtype(
    [
        ("R", "f8", (3, 3)),
        ("t", "f8", (3,)),
        ("axis", "f8", (3,)),
        ("slides", "i8"),
        ("parent", "i8"),
        ("slope", "f8"),
        ("offset", "f8"),
        ("strength", "f8"),
        ("lever", "f8"),
    ]
)
SPHERE = np.dtype(
    [("joint", "i8"), ("centre", "f8", (3,)), ("radius", "f8"), ("moves", "i8"), ("sinks", "i8")]
)
PAIR = np.dtype([("a", "i8"), ("b", "i8"), ("touching", "f8")])
OBSTACLE = np.dtype([("centre", "f8", (3,)), ("radius", "f8")])
CAMERA = np.dtype(
    [
        ("R", "f8", (3, 3)),
        ("t", "f8", (3,)),
        ("joint", "i8"),
        ("spin", "f8"),
        ("task", "f8"),
        ("distance", "f8"),
        ("roll", "f8"),
        ("fade", "f8", (2,)),
        ("repulsion", "f8"),
        ("reach", "f8"),
        ("own_repulsion", "f8"),
        ("own_reach", "f8"),
        ("contact", "f8"),
        ("push", "f8"),
        ("squared", "i8"),
        ("always", "i8"),
    ]
)
GOAL = np.dtype(
    [
        ("p", "f8", (3,)),
        ("velocity", "f8", (3,)),
        ("distance", "f8"),
        ("emergency", "i8"),
        ("floor", "f8"),
        ("gap", "f8"),
        ("own_gap", "f8"),
    ]
)
_HEAD = HEAD.itemsize


@kernel
def _scene(packed):
    """Return records of the robot and goal, rows (position of the scene, `ways`) and obstacles."""
    head = packed[:_HEAD].view(HEAD)[0]
    cameras = packed[head.cameras : head.goals].view(CAMERA)
    goals = packed[head.goals : head.joints].view(GOAL)
    joints = packed[head.joints : head.rows].view(JOINT)
    rows = packed[head.rows : head.spheres].view(np.float64).reshape((3, len(joints)))
    spheres = packed[head.spheres : head.pairs].view(SPHERE)
    pairs = packed[head.pairs : head.obstacles].view(PAIR)
    obstacles = packed[head.obstacles : head.end].view(OBSTACLE)
    return (joints, spheres, pairs, cameras), goals, rows, obstacles


@kernel
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def _cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@kernel
def _turned(R, v):
    """Return R v."""
    return (
        R[0, 0] * v[0] + R[0, 1] * v[1] + R[0, 2] * v[2],
        R[1, 0] * v[0] + R[1, 1] * v[1] + R[1, 2] * v[2],
        R[2, 0] * v[0] + R[2, 1] * v[1] + R[2, 2] * v[2],
    )


@kernel
def _product(A, B, out):
    for i in range(3):
        for j in range(3):
            out[i, j] = A[i, 0] * B[0, j] + A[i, 1] * B[1, j] + A[i, 2] * B[2, j]


@kernel
def _about(axis, angle, out):
    """Write Rodrigues' rotation matrix to `out`."""
    c, s = cos(angle), sin(angle)
    x, y, z = axis[0], axis[1], axis[2]
    d = 1.0 - c
    out[0, 0], out[0, 1], out[0, 2] = c + d * x * x, d * x * y - s * z, d * x * z + s * y
    out[1, 0], out[1, 1], out[1, 2] = d * x * y + s * z, c + d * y * y, d * y * z - s * x
    out[2, 0], out[2, 1], out[2, 2] = d * x * z - s * y, d * y * z + s * x, c + d * z * z


@kernel
def _place(joints, q, R, t, J):
    """Compute `CameraArm.place`: joint placements (n, 3, 3), (n, 3) and spatial Jacobian (6, n)."""
    here, turn = np.empty((3, 3)), np.empty((3, 3))
    for i in range(len(joints)):
        joint = joints[i]
        k = joint.parent
        if k < 0:
            here[:] = joint.R
            t[i] = joint.t
        else:
            _product(R[k], joint.R, here)
            x, y, z = _turned(R[k], joint.t)
            t[i, 0], t[i, 1], t[i, 2] = t[k, 0] + x, t[k, 1] + y, t[k, 2] + z
        a = _turned(here, joint.axis)
        if joint.slides:
            R[i] = here
            for c in range(3):
                t[i, c] += q[i] * a[c]
                J[c, i], J[3 + c, i] = a[c], 0.0
        else:
            _about(joint.axis, q[i], turn)
            _product(here, turn, R[i])
            moment = _cross(t[i], a)
            for c in range(3):
                J[c, i], J[3 + c, i] = moment[c], a[c]


@kernel
def _centres(spheres, R, t):
    """Compute `CameraArm.centres`, and those of the base, (k, 3)."""
    centres = np.empty((len(spheres), 3))
    for k in range(len(spheres)):
        sphere = spheres[k]
        if sphere.joint < 0:
            centres[k] = sphere.centre
        else:
            o = _turned(R[sphere.joint], sphere.centre)
            for c in range(3):
                centres[k, c] = t[sphere.joint, c] + o[c]
    return centres


@kernel
def _apart(o, b):
    """Return o − b and its norm."""
    x, y, z = o[0] - b[0], o[1] - b[1], o[2] - b[2]
    return (x, y, z), sqrt(x * x + y * y + z * z)


@kernel
def _gradients(e1, e2, e3, ray, distance):
    """Compute `stereographic._error`."""
    s = 1.0 + _dot(e3, ray)
    psi1, psi2 = _dot(e1, ray) / s, _dot(e2, ray) / s
    h = (ray[0] + e3[0], ray[1] + e3[1], ray[2] + e3[2])
    scale = 1.0 / (s * distance)
    g1 = ((e1[0] - psi1 * h[0]) * scale, (e1[1] - psi1 * h[1]) * scale, (e1[2] - psi1 * h[2]) * scale)
    g2 = ((e2[0] - psi2 * h[0]) * scale, (e2[1] - psi2 * h[1]) * scale, (e2[2] - psi2 * h[2]) * scale)
    return psi1, psi2, g1, g2, ray, distance


@kernel
def _error(e1, e2, e3, r):
    """Compute `stereographic.camera_error`."""
    distance = sqrt(_dot(r, r))
    if distance < LENS_GUARD:
        return _gradients(e1, e2, e3, e3, LENS_GUARD)
    ray = (r[0] / distance, r[1] / distance, r[2] / distance)
    y1, y2 = _dot(e1, ray), _dot(e2, ray)
    away = hypot(y1, y2)
    if _dot(e3, ray) < 0.0 and away < ANTIPODE_GUARD:
        u1, u2 = 1.0, 0.0
        if away > 0.0:
            u1, u2 = y1 / away, y2 / away
        a, b = sin(ANTIPODE_GUARD), cos(pi - ANTIPODE_GUARD)
        ray = (
            a * (u1 * e1[0] + u2 * e2[0]) + b * e3[0],
            a * (u1 * e1[1] + u2 * e2[1]) + b * e3[1],
            a * (u1 * e1[2] + u2 * e2[2]) + b * e3[2],
        )
    return _gradients(e1, e2, e3, ray, distance)


@kernel
def _roll(e1, e2, camera):
    """Compute `subtasks.roll_rate`."""
    off_vertical = asin(min(hypot(e1[2], e2[2]), 1.0))
    share = (off_vertical - camera.fade[0]) / (camera.fade[1] - camera.fade[0])
    share = min(max(share, 0.0), 1.0)
    return -camera.roll * camera.spin * share * share * (3.0 - 2.0 * share) * atan2(e2[2], e1[2])


@kernel
def _push(d, eta, reach, camera):
    """Compute `repulsion.push`."""
    d = max(d, camera.contact)
    strength = eta * (1.0 / d - 1.0 / reach) / (d * d)
    return min(max(strength, 0.0), camera.push)


@kernel
def _pushed(F, joints, J, joint, force, at):
    """Add Jᵀ [f; o × f] for a force at a point that `joint` carries."""
    moment = _cross(at, force)
    while joint >= 0:
        F[joint] += (
            J[0, joint] * force[0]
            + J[1, joint] * force[1]
            + J[2, joint] * force[2]
            + J[3, joint] * moment[0]
            + J[4, joint] * moment[1]
            + J[5, joint] * moment[2]
        )
        joint = joints[joint].parent


@kernel
def _repulsion(F, q, scene, placed):
    """Compute `CameraLaw._repulsion`."""
    (joints, spheres, _, cameras), goals, rows, _ = scene
    R, t, J = placed
    camera, goal = cameras[0], goals[0]
    way = 0.0
    for i in range(len(joints)):
        way += abs(q[i] - rows[0, i]) * joints[i].lever
    others, own = way >= goal.gap - camera.reach, way >= goal.own_gap - camera.own_reach
    if not (others or own):
        return
    centres = _centres(spheres, R, t)
    if others:
        _from_others(F, scene, J, centres)
    if own:
        _from_itself(F, scene, J, centres)


@kernel
def _from_others(F, scene, J, centres):
    """Compute `Repulsion.wrenches`."""
    (joints, spheres, _, cameras), goals, _, obstacles = scene
    camera, goal = cameras[0], goals[0]
    eta, reach = camera.repulsion, camera.reach
    for k in range(len(spheres)):
        sphere, o = spheres[k], centres[k]
        if not sphere.moves:
            continue
        for obstacle in obstacles:
            b = obstacle.centre
            apart = (o[0] - b[0], o[1] - b[1], o[2] - b[2])
            squared = _dot(apart, apart)
            touching = sphere.radius + obstacle.radius
            if squared < (touching + reach) ** 2:
                distance = max(sqrt(squared), 1e-9)
                s = _push(distance - touching, eta, reach, camera) / distance
                _pushed(F, joints, J, sphere.joint, (apart[0] * s, apart[1] * s, apart[2] * s), o)
        height = o[2] - (sphere.radius + goal.floor)
        if sphere.sinks and height < reach:
            _pushed(F, joints, J, sphere.joint, (0.0, 0.0, _push(height, eta, reach, camera)), o)


@kernel
def _from_itself(F, scene, J, centres):
    """Compute `OwnPairs.force`."""
    joints, spheres, pairs, cameras = scene[0]
    camera = cameras[0]
    for pair in pairs:
        o = centres[pair.a]
        apart, distance = _apart(o, centres[pair.b])
        gap = distance - pair.touching
        if gap < camera.own_reach:
            s = _push(gap, camera.own_repulsion, camera.own_reach, camera) / max(distance, 1e-9)
            f = (apart[0] * s, apart[1] * s, apart[2] * s)
            _pushed(F, joints, J, spheres[pair.a].joint, f, o)
            _pushed(F, joints, J, spheres[pair.b].joint, (-f[0], -f[1], -f[2]), o)


@kernel
def _terms(q, scene, M, F_rep):
    """Write ∂Ψ/∂q, ∂‖x − p‖/∂q and F of `CameraLaw.terms` to M (4, n); return Ψ, P ṗ and ray · ṗ."""
    (joints, _, _, cameras), goals, _, _ = scene
    camera, goal = cameras[0], goals[0]
    n = len(joints)
    R, t, J = np.empty((n, 3, 3)), np.empty((n, 3)), np.empty((6, n))
    _place(joints, q, R, t, J)
    last = camera.joint
    axes = np.empty((3, 3))
    _product(R[last], camera.R, axes)
    e1 = (axes[0, 0], axes[1, 0], axes[2, 0])
    e2 = (axes[0, 1], axes[1, 1], axes[2, 1])
    e3 = (axes[0, 2], axes[1, 2], axes[2, 2])
    o = _turned(R[last], camera.t)
    x = (t[last, 0] + o[0], t[last, 1] + o[1], t[last, 2] + o[2])
    p = (goal.p[0], goal.p[1], goal.p[2])
    psi1, psi2, g1, g2, ray, distance = _error(e1, e2, e3, (p[0] - x[0], p[1] - x[1], p[2] - x[2]))
    M[:] = 0.0
    F_rep[:] = 0.0
    _pushed(M[0], joints, J, last, (-g1[0], -g1[1], -g1[2]), p)
    _pushed(M[1], joints, J, last, (-g2[0], -g2[1], -g2[2]), p)
    _pushed(M[2], joints, J, last, (-ray[0], -ray[1], -ray[2]), x)
    pull = camera.distance * (goal.distance - distance)
    for i in range(n):
        M[3, i] = pull * M[2, i]
    M[3, last] += _roll(e1, e2, camera)
    _repulsion(F_rep, q, scene, (R, t, J))
    v = goal.velocity
    return psi1, psi2, _dot(g1, v), _dot(g2, v), _dot(ray, v)


@kernel
def _weights(q, scene, directed):
    """Write the result of `CameraLaw._directed` to `directed` (2, n)."""
    (joints, _, _, cameras), _, rows, _ = scene
    for i in range(len(joints)):
        directed[0, i], directed[1, i] = rows[1, i], rows[2, i]
        x = q[i] * joints[i].slope - joints[i].offset
        m = max(1.0 - x * x, 0.0)
        m *= m
        H = joints[i].strength * abs(x)
        if cameras[0].squared:
            m *= m
            H *= H
        w = m / (m + H)
        if x < 0.0 or cameras[0].always:
            directed[0, i] *= w
        if x > 0.0 or cameras[0].always:
            directed[1, i] *= w


@kernel
def _gradient(M, F_rep, rate, w, steepness, qd):
    """Compute `gradient.weighted_gradient`."""
    n = len(w)
    s11 = s12 = s22 = b1 = b2 = 0.0
    for i in range(n):
        F = (M[3, i] + F_rep[i]) * w[i]
        s11 += M[0, i] * w[i] * M[0, i]
        s12 += M[0, i] * w[i] * M[1, i]
        s22 += M[1, i] * w[i] * M[1, i]
        b1 += M[0, i] * F
        b2 += M[1, i] * F
    least = 0.5 * (s11 + s22) - sqrt(0.25 * (s11 - s22) ** 2 + s12 * s12)
    missing = (DAMPING * steepness) ** 2 - least
    if missing > 0.0:
        s11 += missing
        s22 += missing
    det = s11 * s22 - s12 * s12
    c1, c2 = rate[0] - b1, rate[1] - b2
    l1, l2 = (s22 * c1 - s12 * c2) / det, (s11 * c2 - s12 * c1) / det
    for i in range(n):
        qd[i] = (l1 * M[0, i] + l2 * M[1, i] + M[3, i] + F_rep[i]) * w[i]


@kernel
def _limited(M, F_rep, rate, weights, steepness, qd):
    """Compute `gradient.limited_gradient`; `weights` (3, n): down, up, and room for the chosen ones."""
    n = len(qd)
    directed, w = weights[:2], weights[2]
    for i in range(n):
        w[i] = max(directed[0, i], directed[1, i])
    while True:
        _gradient(M, F_rep, rate, w, steepness, qd)
        again = False
        for i in range(n):
            taken = w[i]
            if qd[i] != 0.0:
                taken = directed[1, i] if qd[i] > 0.0 else directed[0, i]
            if taken < w[i]:
                w[i], again = taken, True
        if not again:
            return


@kernel
def _field(q, scene):
    """Return f(q, p, d_r) of (16), (n,)."""
    arm, goals, _, _ = scene
    camera = arm[3][0]
    n = len(q)
    room, qd = np.empty((8, n)), np.empty(n)
    M, F_rep, weights = room[:4], room[4], room[5:]
    psi1, psi2, drift1, drift2, _ = _terms(q, scene, M, F_rep)
    _weights(q, scene, weights)
    if goals[0].emergency:
        for i in range(n):
            qd[i] = weights[1 if F_rep[i] > 0.0 else 0, i] * F_rep[i]
        return qd
    steepness = 0.5 * (1.0 + psi1 * psi1 + psi2 * psi2)
    rate = (-camera.task * psi1 - drift1, -camera.task * psi2 - drift2)
    _limited(M, F_rep, rate, weights, steepness, qd)
    return qd


@kernel
def evaluate(q, packed):
    """Compute `CameraLaw.__call__` in place: q becomes f(q). Returning an array would cost half of f."""
    q[:] = _field(q, _scene(packed))


@kernel
def _rk4(q, h, k1, scene):
    """Compute `integrate.rk4_turn`."""
    k2 = _field(q + 0.5 * h * k1, scene)
    k3 = _field(q + 0.5 * h * k2, scene)
    k4 = _field(q + h * k3, scene)
    changed, turned = 0.0, 0.0
    for i in range(len(q)):
        changed, turned = max(changed, abs(k2[i] - k1[i])), max(turned, abs(k3[i] - k2[i]))
    turn = turned / changed if changed > 0.0 else 0.0
    return q + (h / 6.0) * (k1 + 2.0 * (k2 + k3) + k4), turn


@kernel
def advance(q, h, packed):
    """Compute `CameraLaw.step`, in place: q becomes the result."""
    scene = _scene(packed)
    q[:] = _rk4(q, h, _field(q, scene), scene)[0]


@kernel
def _integrate(start, origin, reach, scheme, scene):
    step, budget, split, resolution, tolerance, most = scheme
    q, longest = start.copy(), step
    for steps in range(budget):
        k1 = _field(q, scene)
        made, fastest, slowest, left = 0.0, 0.0, 0.0, False
        for i in range(len(q)):
            way = abs(q[i] - origin[i])
            made, fastest = max(made, way), max(fastest, abs(k1[i]))
            slowest = max(slowest, abs(k1[i]) / (split * reach[i]))
            left = left or way >= reach[i]
        if step * fastest <= max(resolution, tolerance * made):
            return q, steps, 0
        if left:
            return q, steps, 1
        h = min(longest, 1.0 / slowest) if slowest > 0.0 else longest
        ahead, turn = _rk4(q, h, k1, scene)
        if turn > most:
            longest = 0.5 * h / turn
            continue
        q, longest = ahead, min(step, 2.0 * h)
    for i in range(len(q)):
        if abs(q[i] - origin[i]) >= reach[i]:
            return q, budget, 1
    return q, budget, 2


@kernel
def integrate(start, origin, reach, scheme, packed):
    """Compute `integrate.integrate`: q^r, steps made, and 0 converged, 1 bound or 2 budget."""
    return _integrate(start, origin, reach, scheme, _scene(packed))


@kernel
def task(q, packed):
    """Compute `CameraLaw.task`: Ψ_1, Ψ_2 and M, whose first two rows are ∂Ψ/∂q."""
    M = np.empty((4, len(q)))
    psi1, psi2 = _task(q, _scene(packed), M)
    return psi1, psi2, M


@kernel
def _task(q, scene, M):
    psi1, psi2, _, _, _ = _terms(q, scene, M, np.empty(len(q)))
    return psi1, psi2


@kernel
def induced(q, packed):
    """Compute `CameraLaw.induced` for the goal's own velocity, (n,)."""
    return _induced(q, _scene(packed))


@kernel
def _induced(q, scene):
    n = len(q)
    M, F_rep, w, directed = np.empty((4, n)), np.empty(n), np.empty(n), np.empty((2, n))
    psi1, psi2, drift1, drift2, along = _terms(q, scene, M, F_rep)
    _weights(q, scene, directed)
    for i in range(n):
        w[i] = min(directed[0, i], directed[1, i])
    slope = 2.0 / (1.0 + psi1 * psi1 + psi2 * psi2)
    S, rate = INDUCED_DAMPING * np.eye(3), np.array((-slope * drift1, -slope * drift2, -along))
    M[0] *= slope
    M[1] *= slope
    for a in range(3):
        for b in range(3):
            for i in range(n):
                S[a, b] += M[a, i] * w[i] * M[b, i]
    # Solved by cofactors: symmetric, positive definite, 3 × 3.
    c0 = _cross(S[1], S[2])
    c1, c2 = _cross(S[2], S[0]), _cross(S[0], S[1])
    det = _dot(S[0], c0)
    qd = np.zeros(n)
    for a in range(3):
        load = (c0[a] * rate[0] + c1[a] * rate[1] + c2[a] * rate[2]) / det
        for i in range(n):
            qd[i] += load * M[a, i] * w[i]
    return qd


@kernel
def survey(q, centres, radii, height, packed):
    """Complete a scene around q for obstacles (m, 3), (m,) and a floor; return both gaps of `Scene`."""
    scene = _scene(packed)
    _, goals, rows, obstacles = scene
    goal = goals[0]
    for k in range(len(obstacles)):
        obstacles[k].radius = radii[k]
        for c in range(3):
            obstacles[k].centre[c] = centres[k, c]
    goal.floor = height
    goal.gap, goal.own_gap = _gaps(q, scene)
    for i in range(len(q)):
        rows[0, i] = q[i]
    return goal.gap, goal.own_gap


@kernel
def _gaps(q, scene):
    """Compute `Repulsion.least_gap` and `OwnPairs.least_gap` at q."""
    (joints, spheres, pairs, _), goals, _, obstacles = scene
    floor = goals[0].floor
    n = len(joints)
    R, t, J = np.empty((n, 3, 3)), np.empty((n, 3)), np.empty((6, n))
    _place(joints, q, R, t, J)
    centres = _centres(spheres, R, t)
    least, own = np.inf, np.inf
    for k in range(len(spheres)):
        sphere, o = spheres[k], centres[k]
        if not sphere.moves:
            continue
        for obstacle in obstacles:
            _, distance = _apart(o, obstacle.centre)
            least = min(least, distance - (sphere.radius + obstacle.radius))
        if sphere.sinks:
            least = min(least, o[2] - (sphere.radius + floor))
    for pair in pairs:
        _, distance = _apart(centres[pair.a], centres[pair.b])
        own = min(own, distance - pair.touching)
    return least, own


@kernel
def look(q, x, y, z, wanted, packed):
    """Compute `view_errors` for the target (x, y, z)."""
    joints, _, _, cameras = _scene(packed)[0]
    camera, n = cameras[0], len(joints)
    R, t, J, axes = np.empty((n, 3, 3)), np.empty((n, 3)), np.empty((6, n)), np.empty((3, 3))
    _place(joints, q, R, t, J)
    _product(R[camera.joint], camera.R, axes)
    lens = _tip(camera, R, t)
    r = (x - lens[0], y - lens[1], z - lens[2])
    across = hypot(
        axes[0, 0] * r[0] + axes[1, 0] * r[1] + axes[2, 0] * r[2],
        axes[0, 1] * r[0] + axes[1, 1] * r[1] + axes[2, 1] * r[2],
    )
    along = axes[0, 2] * r[0] + axes[1, 2] * r[1] + axes[2, 2] * r[2]
    return atan2(across, along), hypot(across, along) - wanted


@kernel
def watch(q, centres, packed):
    """Compute `Leader.at`: write the spheres' centres (k, 3), and return the point of the tool."""
    joints, spheres, _, cameras = _scene(packed)[0]
    n = len(joints)
    R, t, J = np.empty((n, 3, 3)), np.empty((n, 3)), np.empty((6, n))
    _place(joints, q, R, t, J)
    centres[:] = _centres(spheres, R, t)
    return _tip(cameras[0], R, t)


@kernel
def _tip(frame, R, t):
    """Return the origin of a frame that a joint or the base (joint −1) carries."""
    if frame.joint < 0:
        return frame.t[0], frame.t[1], frame.t[2]
    o = _turned(R[frame.joint], frame.t)
    return t[frame.joint, 0] + o[0], t[frame.joint, 1] + o[1], t[frame.joint, 2] + o[2]


# --- chase of the optimum: bounds, shaping and kept view ---------------------------------------------------

# Rows (n,) of the array for `chase`: positions, last increment and bounds, and its result.
START, SETPOINT, LAST, LOWER, UPPER, STEP, CHANGE, FAR, DOWN, UP, DQ = range(11)


@kernel
def _decay(dq, rows):
    """Compute `IncrementBounds._decay`."""
    decay = np.inf
    for i in range(len(dq)):
        if abs(dq[i]) > 1e-15:
            decay = min(decay, rows[CHANGE, i] / abs(dq[i]))
    return decay


@kernel
def _stop(dq, rows):
    """Compute `IncrementBounds.stop`."""
    decay = _decay(dq, rows)
    if decay >= 1.0:
        return 0.0
    ticks = floor(1.0 / decay)
    return ticks - 0.5 * decay * ticks * (ticks + 1)


@kernel
def _clip(value, low, high):
    return min(max(value, low), high)


@kernel
def _admits(dq, rows):
    """Compute `IncrementBounds.admits`."""
    share = 1.0 + _stop(dq, rows)
    for i in range(len(dq)):
        at = rows[SETPOINT, i]
        ahead = rows[UPPER, i] - at if dq[i] > 0.0 else at - rows[LOWER, i]
        if not abs(share * dq[i]) <= max(ahead, 0.0) + 1e-12:
            return False
    return True


@kernel
def _box(wanted, rows, low, high):
    """Compute `IncrementBounds.box`."""
    share = 1.0 / (1.0 + _stop(wanted, rows))
    for i in range(len(wanted)):
        at, step = rows[SETPOINT, i], rows[STEP, i]
        least, most = rows[LAST, i] - rows[CHANGE, i], rows[LAST, i] + rows[CHANGE, i]
        down, up = min(rows[LOWER, i] - at, 0.0), max(rows[UPPER, i] - at, 0.0)
        low[i] = _clip(max(-step, share * down), least, most)
        high[i] = _clip(min(step, share * up), least, most)


@kernel
def _within(wanted, rows, dq):
    """Compute `IncrementBounds.within`; `dq` may be `wanted`."""
    n = len(wanted)
    room = np.empty((3, n))
    clipped, low, high = room[0], room[1], room[2]
    for i in range(n):
        clipped[i] = _clip(wanted[i], -rows[STEP, i], rows[STEP, i])
    _box(clipped, rows, low, high)
    for i in range(n):
        dq[i] = _clip(wanted[i], low[i], high[i])
    if not _admits(dq, rows):
        _blend(dq, rows)


@kernel
def _blend(dq, rows):
    """Compute `IncrementBounds._blend` of the braking increment and `dq`, in place."""
    n = len(dq)
    room = np.empty((3, n))
    safe, wanted, tried = room[0], room[1], room[2]
    braked = max(0.0, 1.0 - _decay(rows[LAST], rows))
    for i in range(n):
        safe[i], wanted[i] = rows[LAST, i] * braked, dq[i]
    low, high = 0.0, 1.0
    for _ in range(12):
        middle = 0.5 * (low + high)
        for i in range(n):
            tried[i] = safe[i] + middle * (wanted[i] - safe[i])
        if _admits(tried, rows):
            low = middle
        else:
            high = middle
    for i in range(n):
        dq[i] = safe[i] + low * (wanted[i] - safe[i])


@kernel
def _braking_increment(way, change):
    """Compute `shaping.braking_increment`."""
    return 0.5 * (sqrt(change * (change + 8.0 * way)) - change)


@kernel
def _reach(rows, induced, reach):
    """Compute `Chase._reach`."""
    for i in range(len(reach)):
        change = shaping.RESERVE * rows[CHANGE, i]
        soon = min(abs(rows[LAST, i]) + SOON * rows[CHANGE, i], rows[STEP, i])
        way = soon * (soon + change) / (2.0 * change)
        reach[i] = min(way + abs(induced[i]), rows[FAR, i])


@kernel
def _shape(chord, induced, rows, wanted):
    """Compute `shaping.shape_chord`."""
    share = 1.0
    for i in range(len(chord)):
        rest = abs(chord[i] - induced[i])
        if rest > 1e-15:
            braking = _braking_increment(rest, shaping.RESERVE * rows[CHANGE, i])
            limit = min(braking, max(rows[STEP, i] - abs(induced[i]), 0.0))
            share = min(share, limit / rest)
    for i in range(len(chord)):
        wanted[i] = induced[i] + share * (chord[i] - induced[i])


@kernel
def _view(psi1, psi2):
    """Compute `view_keeping.view_vector`."""
    rho = hypot(psi1, psi2)
    scale = 2.0 if rho < 1e-9 else 2.0 * atan(rho) / rho
    return scale * psi1, scale * psi2


@kernel
def _projection(v):
    """Compute `view_keeping.projection`."""
    theta = hypot(v[0], v[1])
    scale = 0.5 if theta < 1e-9 else tan(0.5 * theta) / theta
    return scale * v[0], scale * v[1]


@kernel
def _slow(dq, induced, psi1, psi2, M, rows):
    """Compute `view_keeping.slowed`, in place."""
    rho = hypot(psi1, psi2)
    if rho < 1e-4:
        return
    factor, squares, falls = 2.0 / ((1.0 + rho * rho) * rho), 0.0, 0.0
    for i in range(len(dq)):
        slope = factor * (psi1 * M[0, i] + psi2 * M[1, i])
        squares += (slope * rows[CHANGE, i]) ** 2
        falls -= slope * (dq[i] - induced[i])
    may = _braking_increment(2.0 * atan(rho), view_keeping.RESERVE * sqrt(squares))
    if falls > may:
        for i in range(len(dq)):
            dq[i] = induced[i] + (may / falls) * (dq[i] - induced[i])


@kernel
def _drawn_in(v, start, end):
    """Compute `view_keeping.drawn_in`."""
    way = (end[0] - start[0], end[1] - start[1])
    squared, share = way[0] ** 2 + way[1] ** 2, 1.0
    if squared > 0.0:
        share = _clip(((v[0] - start[0]) * way[0] + (v[1] - start[1]) * way[1]) / squared, 0.0, 1.0)
    widest = hypot(start[0] + share * way[0], start[1] + share * way[1])
    angle = hypot(v[0], v[1])
    scale = 1.0 if angle <= widest else widest / angle
    return scale * v[0], scale * v[1]


@kernel
def _floor(M, low, high, mobility):
    """Write the mobilities of `view_keeping.corrected`, and return its damping."""
    trace = 0.0
    for i in range(len(mobility)):
        mobility[i] = (high[i] - low[i]) ** 2
        trace += (M[0, i] * M[0, i] + M[1, i] * M[1, i]) * mobility[i]
    return view_keeping.DAMPING * trace


@kernel
def _correct(dq, e1, e2, M, low, high):
    """Compute `view_keeping.corrected`, in place."""
    n = len(dq)
    mobility = np.empty(n)
    damping = _floor(M, low, high, mobility)
    if damping == 0.0:
        return
    for _ in range(view_keeping.ROUNDS):
        s11, s12, s22 = damping, 0.0, damping
        for i in range(n):
            s11 += M[0, i] * mobility[i] * M[0, i]
            s12 += M[0, i] * mobility[i] * M[1, i]
            s22 += M[1, i] * mobility[i] * M[1, i]
        det = s11 * s22 - s12 * s12
        l1, l2 = (s22 * e1 - s12 * e2) / det, (s11 * e2 - s12 * e1) / det
        left = False
        for i in range(n):
            u = _clip(dq[i] + (l1 * M[0, i] + l2 * M[1, i]) * mobility[i], low[i], high[i])
            e1 -= M[0, i] * (u - dq[i])
            e2 -= M[1, i] * (u - dq[i])
            dq[i] = u
            if low[i] < u < high[i]:
                left = True
            else:
                mobility[i] = 0.0
        if not left or max(abs(e1), abs(e2)) < 1e-12:
            return


@kernel
def _keep_view(dq, induced, end, rows, scene):
    """Compute `Chase._with_kept_view`, in place."""
    n = len(dq)
    M, room = np.empty((4, n)), np.empty((3, n))
    at, low, high = room[0], room[1], room[2]
    here = _view(*_task(end, scene, M))
    for i in range(n):
        at[i] = rows[START, i] + induced[i]
    psi1, psi2 = _task(at, scene, M)
    _slow(dq, induced, psi1, psi2, M, rows)
    _within(dq, rows, dq)
    start = _view(psi1, psi2)
    for i in range(n):
        at[i] = rows[START, i] + dq[i]
    psi1, psi2 = _task(at, scene, M)
    v = _view(psi1, psi2)
    allowed = _drawn_in(v, start, here)
    if allowed[0] == v[0] and allowed[1] == v[1]:
        return
    wanted = _projection(allowed)
    _box(dq, rows, low, high)
    _correct(dq, wanted[0] - psi1, wanted[1] - psi2, M, low, high)
    _within(dq, rows, dq)


@kernel
def _aim(aim, rows, scene):
    """Write the goal, but not its velocity; return True in an emergency."""
    _, goals, ways, _ = scene
    goal = goals[0]
    for c in range(3):
        goal.p[c], goal.velocity[c] = aim[c], 0.0
    goal.distance, goal.emergency = aim[6], int(aim[7])
    for i in range(len(rows[START])):
        ways[1, i], ways[2, i] = rows[DOWN, i], rows[UP, i]
    return aim[7] != 0.0


@kernel
def _carried(aim, period, rows, scene, induced):
    """Compute `Chase._induced`."""
    induced[:] = 0.0
    if aim[7] != 0.0 or (aim[3] == 0.0 and aim[4] == 0.0 and aim[5] == 0.0):
        return
    velocity = scene[1][0].velocity
    for c in range(3):
        velocity[c] = aim[3 + c]
    qd = _induced(rows[START], scene)
    for i in range(len(qd)):
        induced[i] = period * qd[i]
    velocity[:] = 0.0


@kernel
def _furthest(a, b):
    furthest = 0.0
    for i in range(len(a)):
        furthest = max(furthest, abs(a[i] - b[i]))
    return furthest


@kernel
def chase(aim, rows, numbers, packed):
    """Compute `Chase.step`: write dq, and return the steps made, the end as `integrate`, and `bounded`.

    Args:
        aim: focus, its velocity, wanted distance and 1.0 in an emergency, (8,).
        rows: see `START` to `DQ`, (11, n).
        numbers: period, and the parameters of the scheme, (7,).
        packed: the scene, whose goal is overwritten.
    """
    scene, n = _scene(packed), rows.shape[1]
    emergency = _aim(aim, rows, scene)
    room = np.empty((5, n))
    induced, reach, start, chord, wanted = room[0], room[1], room[2], room[3], room[4]
    q, dq = rows[START], rows[DQ]
    _carried(aim, numbers[0], rows, scene, induced)
    _reach(rows, induced, reach)
    for i in range(n):
        start[i] = q[i] + induced[i]
    scheme = (numbers[1], int(numbers[2]), numbers[3], numbers[4], numbers[5], numbers[6])
    end, steps, ended = _integrate(start, q, reach, scheme, scene)
    for i in range(n):
        chord[i] = end[i] - q[i]
    _shape(chord, induced, rows, wanted)
    _within(wanted, rows, dq)
    bounded = _furthest(dq, wanted) > SHORT
    if not emergency and _furthest(chord, dq) > SHORT:
        _keep_view(dq, induced, end, rows, scene)
    return steps, ended, bounded
