"""Slabs of the groups, compared with the documented formula on the oracle's kinematics and bodies."""

import numpy as np
import pytest

from armgate.gate.clearance import Clearance
from armgate.gate.clearance.pair_groups import ChainGroup
from armgate.gate.clearance.prefilter import MARGIN
from armgate.gate.occupancy import Occupancy
from gate import scenes
from gate.oracle import Oracle

CELLS = ("corner", "tree", "duel", "mesh")


class FormulaSlab:
    """Slab of one pair by the documented formula, body by body and node by node."""

    def __init__(self, cell):
        self.cell, self.oracle = cell, Oracle(cell)
        self.at = {name: k for k, name in enumerate(self.oracle.names)}

    def placed(self, robot, q):
        """Return R and t of every body with one robot at q, the others anywhere."""
        qs = [np.array([r.start]) for r in self.cell.robots]
        qs[robot] = np.array([q])
        R, t = self.oracle.place(qs)
        return R[0], t[0]

    def reach(self, robot, body, n, occupied, motion, bend):
        """Return the largest n·x of a body over an occupancy, with its deviation; n in the world frame."""
        k, most = self.at[body], -np.inf
        for q in occupied.nodes:
            R, t = self.placed(robot, q)
            most = max(most, float(n @ t[k]) + self.oracle.solids[k].reach(R[k].T @ n))
        return most + stray(occupied, motion, bend)

    def chained(self, robot, near, tip, n, occupied, motion, bend):
        """Return the slab of two bodies of one chain; n in the frame of the nearer one."""
        a, b, room = self.at[near], self.at[tip], np.inf
        for q in occupied.nodes:
            R, t = self.placed(robot, q)
            world = R[a] @ n
            far = float(world @ (t[b] - t[a])) - self.oracle.solids[b].reach(-(R[b].T @ world))
            room = min(room, far - self.oracle.solids[a].reach(n))
        return room - stray(occupied, motion, bend)


def stray(occupied, motion, bend):
    curl = 0.0
    for p, q in zip(occupied.nodes, occupied.nodes[1:], strict=False):
        d = [abs(x - y) for x, y in zip(p, q, strict=True)]
        n = range(len(d))
        curl = max(curl, sum(d[i] * d[j] * bend[i][j] for i in n for j in n))
    return curl / 8.0 + sum(r * e for r, e in zip(motion, occupied.tube, strict=True))


def some_occupancy(robot, rng, nodes):
    qs = [rng.uniform(robot.lower, robot.upper)]
    qs += [
        np.clip(qs[0] + rng.uniform(-0.4, 0.4, len(qs[0])), robot.lower, robot.upper)
        for _ in range(nodes - 1)
    ]
    tube = tuple(float(x) for x in rng.uniform(0.0, 0.02, robot.model.n))
    return Occupancy(tuple(tuple(map(float, q)) for q in qs), tube)


@pytest.mark.parametrize("nodes", [1, 2, 3])
@pytest.mark.parametrize("name", CELLS)
def test_a_slab_equals_the_documented_formula(name, nodes):
    cell, rng = scenes.SCENES[name](), np.random.default_rng(nodes)
    clearance, written = Clearance(cell, False), FormulaSlab(cell)
    space = clearance.space
    occupied = [some_occupancy(r, rng, nodes if i == 0 else 2) for i, r in enumerate(cell.robots)]
    swept = [space.sweep(i, o) for i, o in enumerate(occupied)]
    for robot in range(len(cell.robots)):
        mine, chain = occupied[robot], cell.robots[robot].model.chain
        for group in clearance.groups[robot]:
            side = space.static if group.other is None else swept[group.other]
            every = np.arange(len(group.ids))
            n = rng.normal(size=(len(group.ids), 3))
            n /= np.linalg.norm(n, axis=1, keepdims=True)
            lb, near, far = group.slab(swept[robot], side, every, n)
            for k, pair in enumerate(group.ids):
                a, b = (cell.bodies[x] for x in (cell.pairs[pair].a, cell.pairs[pair].b))
                assert group.limit[k] == cell.pairs[pair].limit
                assert abs(group.sign[k]) == 1.0
                if group.sign[k] < 0:
                    a, b = b, a
                assert a.robot == robot
                own = space.motion[robot][a.index], space.bend[robot][a.index]
                if isinstance(group, ChainGroup):
                    between = (chain[b.index] & ~chain[a.index]).astype(float)
                    motion = space.motion[robot][b.index] * between
                    bend = space.bend[robot][b.index] * np.outer(between, between)
                    expected = written.chained(robot, a.name, b.name, n[k], mine, motion, bend)
                    assert np.array_equal(group.growth[k], motion)
                    assert near[k] == far[k]
                elif group.other is None:
                    i = written.at[b.name]
                    R, t = written.placed(robot, mine.nodes[0])
                    reach = float(-n[k] @ t[i]) + written.oracle.solids[i].reach(R[i].T @ -n[k])
                    expected = -written.reach(robot, a.name, n[k], mine, *own) - reach
                else:
                    other = group.other
                    theirs = space.motion[other][b.index], space.bend[other][b.index]
                    expected = -written.reach(robot, a.name, n[k], mine, *own)
                    expected -= written.reach(other, b.name, -n[k], occupied[other], *theirs)
                    grown = own[0] + theirs[0] if other == robot else own[0]
                    assert np.array_equal(group.growth[k], grown)
                assert lb[k] == pytest.approx(expected, abs=1e-9)
                assert near[k] < len(mine.nodes)


@pytest.mark.parametrize("name", CELLS)
def test_every_pair_of_a_robot_is_in_one_of_its_groups_and_those_of_its_chain_come_first(name):
    cell = scenes.SCENES[name]()
    clearance = Clearance(cell, False)
    for robot, groups in enumerate(clearance.groups):
        ids = [int(p) for g in groups for p in g.ids]
        mine = [
            k for k, p in enumerate(cell.pairs)
            if any(cell.bodies[x].robot == robot and _moves(cell, cell.bodies[x]) for x in (p.a, p.b))
        ]  # fmt: skip
        assert sorted(ids) == mine
        assert list(clearance.pairs_of[robot]) == ids
        chained = [isinstance(g, ChainGroup) for g in groups]
        assert chained == sorted(chained, reverse=True)
        assert sum(chained) <= 1
        for group in groups:
            static = [not _moves(cell, cell.bodies[k]) for k in group.shape_theirs]
            assert static == [group.other is None] * len(static)
            for k, pair in enumerate(group.ids):
                assert clearance.find(robot, int(pair)) == (group, k)
                shapes = {int(group.shape_mine[k]), int(group.shape_theirs[k])}
                assert shapes == {cell.pairs[pair].a, cell.pairs[pair].b}


def _moves(cell, body):
    return body.robot is not None and cell.robots[body.robot].model.bodies[body.index].joint >= 0


def test_placements_are_computed_once_and_only_at_the_first_access():
    cell = scenes.corner()
    space = Clearance(cell, False).space
    placed = []
    place = space._place
    space.place_with(lambda robot, q: (placed.append(tuple(q)), place(robot, q))[1])
    a, b, c = ((0.0, 0.1, 0.0), (0.1, 0.1, 0.0), (0.2, 0.1, 0.0))
    one = space.sweep(0, Occupancy((a, b), (0.0,) * 3))
    assert placed == []
    assert one.R.shape == (2, len(cell.robots[0].model.bodies), 3, 3)
    _ = one.t
    assert placed == [a, b]
    _ = space.sweep(0, Occupancy((b, c), (0.0,) * 3)).t
    assert placed == [a, b, c]
    for k in range(9):
        _ = space.still(0, (0.3, 0.1, 0.01 * k)).t
    _ = space.still(0, (0.3, 0.1, 0.08)).t
    assert len(placed) == 12
    _ = space.still(0, a).t  # no longer kept
    assert len(placed) == 13


def test_bounds_keep_a_margin_for_rounding():
    """Two balls on one line: the slab along it is the distance less the rounding margin."""
    cell = scenes.head_on(1.1)
    clearance = Clearance(cell, False)
    for i, q in enumerate(((-0.55,), (0.55,))):
        clearance.hold(i, [clearance.space.still(i, q)])
    clearance.prove_all(0)
    assert clearance.bound[0] == pytest.approx(1.0 - MARGIN, abs=1e-12)
    assert clearance.bound[0] <= 1.0 - 0.9 * MARGIN


@pytest.mark.parametrize("name", CELLS)
def test_the_returned_nodes_are_those_at_which_a_plane_separates_least(name):
    cell, rng = scenes.SCENES[name](), np.random.default_rng(7)
    clearance = Clearance(cell, False)
    space = clearance.space

    def nodes_of(robot):
        return np.array(some_occupancy(cell.robots[robot], rng, 3).nodes)

    for robot, groups in enumerate(clearance.groups):
        for group in groups:
            other, chained = group.other, isinstance(group, ChainGroup)
            none = np.zeros(cell.robots[robot].model.n)
            nodes, every = nodes_of(robot), np.arange(len(group.ids))
            mine, one_by_one = (
                space.sweep_nodes(robot, nodes, none),
                [space.sweep_nodes(robot, nodes[i : i + 1], none) for i in range(3)],
            )
            side = space.static
            if other is not None:
                side = mine if other == robot else space.sweep_nodes(other, nodes_of(other), none)
            n = rng.normal(size=(len(every), 3))
            n /= np.linalg.norm(n, axis=1, keepdims=True)
            _, near, far = group.slab(mine, side, every, n)
            separations = [group.slab(m, m if chained else side, every, n)[0] for m in one_by_one]
            assert np.min(separations, axis=0) == pytest.approx(np.choose(near, separations), abs=1e-12)
            if other is not None and not chained:
                ways = one_by_one
                if other != robot:
                    ways = [space.sweep_nodes(other, side.nodes[i : i + 1], none) for i in range(3)]
                separations = [group.slab(mine, w, every, n)[0] for w in ways]
                assert np.min(separations, axis=0) == pytest.approx(np.choose(far, separations), abs=1e-12)


def test_only_bodies_of_which_one_carries_the_other_form_a_chain():
    """On a trunk with two arms: bodies of one arm, or of an arm and the trunk, but not of both arms."""
    cell = scenes.tree()
    clearance = Clearance(cell, False)
    found = {}
    for group in clearance.groups[0]:
        for pair in group.ids:
            a, b = (
                (name.split("/")[1] for name in clearance.names(int(pair)) if "/" in name)
                if (cell.pairs[pair].kind == "self")
                else (None, None)
            )
            if a is not None:
                found[frozenset((a, b))] = isinstance(group, ChainGroup)
    carried = {frozenset(p) for p in (("L0", "L2"), ("L0", "L4"))}
    apart = {frozenset(p) for p in (("L1", "L3"), ("L1", "L4"), ("L2", "L3"), ("L2", "L4"))}
    assert found == dict.fromkeys(carried, True) | dict.fromkeys(apart, False)


@pytest.mark.parametrize(("start", "reach"), [(0.2, 1.0), (0.8, 1.0), (1.5, 1.5), (-1.75, 1.75)])
def test_motion_is_bounded_over_the_limits_and_the_start(start, reach):
    """For a ball on a slide behind a revolute joint the bound is the largest extension of the slide."""
    joints = [
        scenes.joint(-1),
        scenes.joint(
            0, "prismatic", axis=(1, 0, 0), lower=-1.0, upper=0.5, bodies=(scenes.body("sphere", 0.1),)
        ),
    ]
    robot = {"urdf": scenes.urdf(joints), "start": [0.0, start]}
    space = Clearance(scenes.build({"A": robot}), False).space
    (motion,) = space.motion[0]
    assert reach + 0.1 - 1e-9 <= motion[0] <= reach + 0.1 + 1.1e-3  # a millimetre of room
    assert motion[1] == pytest.approx(1.0)
