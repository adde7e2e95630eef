"""Kept bounds and the four stages, by hand: balls and boxes with known distances."""

import numpy as np
import pytest

from armgate.gate.clearance import Clearance
from armgate.gate.clearance.certificate import Budget
from armgate.gate.clearance.pair_check import PairCheck, halves, in_pair_order, middle, segments
from armgate.gate.clearance.prefilter import MARGIN
from gate import scenes

LIMIT = 0.02
PLENTY = 1000


def ball(around, start=(0.0, 0.0, 0.0), shape=None):
    """Return the clearance of a freely moving ball of 5 cm among static bodies, held at its start."""
    robot = {"urdf": scenes.cart((1, 0, 0), (0, 1, 0), (0, 0, 1), shape=shape), "start": list(start)}
    clearance = Clearance(scenes.build({"A": robot}, surroundings=around), False)
    hold(clearance, 0, start)
    return clearance


def two(first=(-0.5, 0.0), second=(0.5, 0.0), shape=None):
    """Return the clearance of two balls of 5 cm in a plane."""
    robots = {
        name: {"urdf": scenes.cart((1, 0, 0), (0, 1, 0), shape=shape), "start": list(start)}
        for name, start in (("A", first), ("B", second))
    }
    return Clearance(scenes.build(robots), False)


def path(clearance, robot, *nodes):
    n = clearance.cell.robots[robot].model.n
    return clearance.space.sweep_nodes(robot, np.array(nodes, dtype=float), np.zeros(n))


def hold(clearance, robot, *nodes):
    clearance.hold(robot, [path(clearance, robot, *nodes)])


def checked(clearance, *nodes, robot=0, step=None, need=LIMIT, budget=PLENTY):
    """Return the result for a new path, and the number of engine queries."""
    needs = np.full(len(clearance.pairs_of[robot]), need)
    step = None if step is None else np.array(step)
    left = Budget(budget)
    found = clearance.check(robot, path(clearance, robot, *nodes), step, needs, left)
    return found, budget - left.left


def sphere(x, y=0.0, z=0.0, radius=0.05):
    return {"shape": {"sphere": radius}, "xyz": [x, y, z]}


# --- kept bounds --------------------------------------------------------------------------------------------


def test_at_first_all_pairs_are_below_their_limits_and_nothing_is_proven():
    clearance = ball({"b": sphere(1.0), "c": sphere(2.0)})
    assert clearance.below(0) == [0, 1]
    assert np.all(np.isneginf(clearance.bound.of(0)))


def test_balls_are_proven_from_centre_to_centre_without_an_engine_query():
    around = {f"b{k}": sphere(*(0.5 * np.array(v))) for k, v in enumerate(
        (x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if (x, y, z) != (0, 0, 0)
    )}  # fmt: skip
    clearance = ball(around)
    clearance.prove_all(0)
    true = [np.linalg.norm(body["xyz"]) - 0.1 for body in around.values()]
    assert clearance.bound.of(0) == pytest.approx(np.array(true) - MARGIN, abs=1e-12)
    assert clearance.certifier.queries == 0
    assert clearance.below(0) == []


def test_the_directions_with_the_best_proofs_are_kept():
    """For the wall, whose centre is far aside: the kept direction. For the ball: the line of centres."""
    around = {"wall": {"shape": {"box": [0.2, 4.0, 4.0]}, "xyz": [0.5, 1.5, 1.0]}, "b": sphere(-0.3, -0.4)}
    clearance = ball(around)
    clearance._n[:] = [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    clearance.prove_all(0)
    assert clearance.bound.of(0) == pytest.approx([0.35 - MARGIN, 0.4 - MARGIN], abs=1e-12)
    assert clearance._n == pytest.approx(np.array([[1.0, 0.0, 0.0], [-0.6, -0.8, 0.0]]), abs=1e-12)


def test_only_near_pairs_cost_engine_queries():
    """Beside a wide wall the line between the centres proves nothing."""
    around = {"wall": {"shape": {"box": [0.2, 4.0, 4.0]}, "xyz": [0.2, 1.5, 1.0]}, "b": sphere(-0.9)}
    clearance = ball(around)
    clearance.prove_all(0)
    assert clearance.bound.of(0) == pytest.approx([0.05, 0.8], abs=1e-6)
    assert 1 <= clearance.certifier.queries <= 2
    assert clearance.below(0) == []


def test_a_kept_bound_that_is_not_a_number_is_below_every_limit_until_a_new_proof():
    clearance = two()
    hold(clearance, 0, (-0.5, 0.0))
    hold(clearance, 1, (0.5, 0.0))
    clearance.prove_all(0)
    assert clearance.below(0) == []
    clearance.bound.put(0, np.array([np.nan]))
    clearance.mark_maybe_below()
    assert clearance.below(0) == clearance.below(1) == [0]
    found, _ = checked(clearance, (-0.5, 0.0), step=(0.0, 0.0), budget=0)
    assert found.binding.pair == 0
    assert clearance.prove_held(0, 0, Budget(1)).lb == pytest.approx(0.9, abs=1e-8)
    assert clearance.below(0) == []


@pytest.mark.parametrize("tube", [np.nan, np.inf])
def test_a_path_with_a_tube_that_is_not_a_number_proves_nothing(tube):
    clearance = two()
    hold(clearance, 0, (-0.5, 0.0))
    hold(clearance, 1, (0.5, 0.0))
    wide = clearance.space.sweep_nodes(0, np.array([[-0.5, 0.0]]), np.full(2, tube))
    with np.errstate(invalid="ignore"):
        found = clearance.check(0, wide, None, np.array([LIMIT]), Budget(PLENTY))
        assert found.binding.pair == 0
        clearance.hold(0, [wide])
        clearance.prove_all(0)
        assert clearance.prove_held(0, 0, Budget(PLENTY)).lb == -np.inf
    assert clearance.below(1) == [0]


def test_directions_between_centres_have_length_one_and_point_up_if_the_centres_coincide():
    around = {"here": sphere(0.5, -0.5), "there": sphere(0.8, -0.1), "near": sphere(0.501, -0.5)}
    clearance = ball(around, (0.5, -0.5, 0.0))
    (group,) = clearance.groups[0]
    n = clearance._between(group, 0)
    assert n == pytest.approx(np.array([[0.0, 0.0, 1.0], [0.6, 0.8, 0.0], [1.0, 0.0, 0.0]]), abs=1e-12)


def test_directions_of_a_chain_are_in_the_frame_of_the_nearer_body():
    cell = scenes.corner()
    clearance = Clearance(cell, False)
    q = (0.7, 0.3, 0.4)
    hold(clearance, 0, q)
    R, t = clearance.space.still(0, q).R[0], clearance.space.still(0, q).t[0]
    chain = clearance.groups[0][0]
    n = clearance._between(chain, 0)
    for k, (a, b) in enumerate(zip(chain.mine, chain.theirs, strict=True)):
        v = t[b] - t[a]
        assert R[a] @ n[k] == pytest.approx(v / np.linalg.norm(v), abs=1e-12)


def test_the_smallest_bound_over_several_held_paths_is_kept():
    clearance = ball({"b": sphere(1.0)})
    for order in ((0.0, 0.5), (0.5, 0.0)):
        clearance.hold(0, [path(clearance, 0, (x, 0.0, 0.0)) for x in order])
        clearance.prove_all(0)
        assert clearance.bound[0] == pytest.approx(0.4, abs=1e-8)


def test_all_pairs_are_compared_with_their_limits_again_after_a_new_proof():
    clearance = ball({"b": sphere(1.0)})
    clearance.prove_all(0)
    assert clearance.below(0) == []
    hold(clearance, 0, (0.89, 0.0, 0.0))
    clearance.prove_all(0)
    assert clearance.below(0) == [0]
    clearance.bound[0] = LIMIT
    assert clearance.below(0) == []  # a bound equal to its limit is not below it


def test_positions_of_a_pair_are_known_if_those_of_both_robots_are():
    clearance = two()
    assert not clearance.positions_known(0)
    hold(clearance, 0, (-0.5, 0.0))
    assert not clearance.positions_known(0)
    clearance.prove_all(0)
    assert np.isneginf(clearance.bound[0])
    assert clearance.certifier.queries == 0
    hold(clearance, 1, (0.5, 0.0))
    assert clearance.positions_known(0)
    assert ball({"b": sphere(1.0)}).positions_known(0)


def test_a_point_bound_holds_for_all_held_paths_of_the_other_robot():
    clearance = two()
    hold(clearance, 0, (-0.5, 0.0))
    clearance.hold(1, [path(clearance, 1, (0.5, 0.0), (0.0, 0.0)), path(clearance, 1, (0.5, 0.5))])
    assert clearance.point_bound(0, 0, (-0.75, 0.0)) == pytest.approx(0.65, abs=1e-6)
    clearance.hold(1, [path(clearance, 1, (0.5, 0.5)), path(clearance, 1, (0.0, 0.0), (0.5, 0.0))])
    assert clearance.point_bound(0, 0, (-0.75, 0.0)) == pytest.approx(0.65, abs=1e-6)


# --- a new path ---------------------------------------------------------------------------------------------


def test_slabs_count_the_held_occupancies_of_other_robots():
    clearance = two()
    hold(clearance, 0, (-0.5, 0.0))
    hold(clearance, 1, (0.5, 0.0))
    clearance.prove_all(0)
    found, queries = checked(clearance, (-0.5, 0.0), (0.25, 0.0))
    assert (found.binding, queries) == (None, 0)
    assert found.lb == pytest.approx([0.15 - MARGIN], abs=1e-12)


def test_nothing_can_be_proven_for_a_robot_of_unknown_position():
    clearance = two()
    hold(clearance, 0, (-0.5, 0.0))
    found, queries = checked(clearance, (-0.5, 0.0))
    assert np.isneginf(found.binding.lb)
    assert (found.binding.pair, found.binding.need, found.binding.points, queries) == (0, LIMIT, None, 0)


def test_without_a_budget_no_engine_is_queried_and_nothing_is_found():
    clearance = ball({"b": sphere(0.5)})
    found, _ = checked(clearance, (0.0, 0.0, 0.0), budget=0)
    assert found.binding is not None
    assert found.binding.points is None
    assert clearance.certifier.queries == 0


def test_one_query_finds_the_direction_and_the_next_path_needs_no_query():
    clearance = ball({"b": sphere(0.3, 0.4)})
    found, queries = checked(clearance, (0.0, 0.0, 0.0), need=0.39)
    assert (found.binding, queries) == (None, 1)
    assert found.lb == pytest.approx([0.4], abs=1e-6)
    assert clearance._n == pytest.approx(np.array([[0.6, 0.8, 0.0]]), abs=1e-4)
    found, queries = checked(clearance, (0.003, 0.004, 0.0), need=0.39)
    assert (found.binding, queries) == (None, 0)


def test_a_pair_that_is_truly_too_near_costs_one_query():
    clearance = ball({"b": sphere(0.3, 0.4)})
    found, queries = checked(clearance, (0.0, 0.0, 0.0), need=0.41)
    assert queries == 1
    assert found.binding.lb == pytest.approx(0.4, abs=1e-6)
    p, q = map(np.array, found.binding.points)
    assert p == pytest.approx([0.03, 0.04, 0.0], abs=1e-4)
    assert q == pytest.approx([0.27, 0.36, 0.0], abs=1e-4)


def test_a_pair_that_is_too_near_because_of_the_tube_costs_one_query():
    clearance = ball({"b": sphere(0.5)})
    new = clearance.space.sweep_nodes(0, np.zeros((1, 3)), np.array([0.01, 0.0, 0.0]))
    for need, free in ((0.3899, True), (0.3901, False), (0.405, False)):
        clearance._n[0] = [0.0, 0.0, 1.0]
        budget = Budget(PLENTY)
        found = clearance.check(0, new, None, np.array([need]), budget)
        assert (found.binding is None) == free
        assert budget.left == PLENTY - 1


BEND = ((-0.5, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.5, 0.0))
"""Return a path around a corner; no plane separates the whole path from a ball inside it at (−0.15, 0.15)."""


@pytest.mark.parametrize(("need", "way_is_free"), [(0.0499, True), (0.0501, False)])
def test_a_path_around_a_corner_is_proven_cell_by_cell(need, way_is_free):
    clearance = ball({"b": sphere(-0.15, 0.15)})
    found, queries = checked(clearance, *BEND, need=need)
    assert (found.binding is None) == way_is_free
    if way_is_free:
        assert found.lb == pytest.approx([need])
    assert 2 < queries < 50


@pytest.mark.parametrize("missing", [-1, 0, 1, 2, 5])
def test_a_pair_beyond_the_budget_is_refused(missing):
    clearance = ball({"b": sphere(-0.15, 0.15)})
    _, needed = checked(clearance, *BEND, need=0.04)
    assert clearance.certifier.queries == needed > 5
    clearance = ball({"b": sphere(-0.15, 0.15)})
    found, _ = checked(clearance, *BEND, need=0.04, budget=needed - missing)
    assert (found.binding is None) == (missing <= 0)
    assert clearance.certifier.queries == min(needed - missing, needed)


@pytest.mark.parametrize("side", [0, 1])
def test_a_path_is_checked_against_every_path_of_the_other_robot(side):
    """The other robot reserves two paths; the near one is the first or the second."""
    for apart, free in ((0.031, True), (0.019, False)):
        clearance = two()
        hold(clearance, 0, (-0.5, 0.0))
        paths = [path(clearance, 1, (0.5, 0.9)), path(clearance, 1, (0.0, 0.1 + apart))]
        clearance.hold(1, paths if side else paths[::-1])
        found, _ = checked(clearance, (-0.5, 0.0), (0.5, 0.0))
        assert (found.binding is None) == free


@pytest.mark.parametrize(("gap", "free"), [(0.05, True), (0.0195, False)])
@pytest.mark.parametrize("robot", [0, 1])
def test_two_paths_are_checked_against_each_other_for_every_timing(gap, free, robot):
    """Both go around corners, one inside the other's corner; either is checked."""
    clearance = two()
    inner = ((-0.5, 0.0), (0.0, 0.0), (0.0, 0.5))
    edge = 0.1 + gap
    outer = ((-0.5, edge), (-edge, edge), (-edge, 0.5))
    hold(clearance, 0, *inner)
    hold(clearance, 1, *outer)
    found, queries = checked(clearance, *(inner, outer)[robot], robot=robot)
    assert (found.binding is None) == free
    assert queries < 200


# --- rotation: deviation from the chords --------------------------------------------------------------------


def bar(around):
    """Return the clearance of a bar of 0.8 m that turns about its end in the plane."""
    along = (0.0, np.pi / 2, 0.0)
    arm = scenes.urdf(
        [scenes.joint(-1, bodies=(scenes.body("capsule", 0.02, 0.8, xyz=(0.4, 0, 0), rpy=along),))]
    )
    clearance = Clearance(scenes.build({"A": {"urdf": arm, "start": [0.0]}}, surroundings=around), False)
    hold(clearance, 0, (0.0,))
    return clearance


@pytest.mark.parametrize(("gap", "free"), [(0.0205, True), (0.0195, False)])
def test_a_rotating_bar_is_proven_in_halves(gap, free):
    """It passes a ball beyond its tip, which comes nearest between the ends of the rotation."""
    reach = 0.8 + 0.02 + gap + 0.05
    clearance = bar({"b": sphere(reach * np.cos(0.4), reach * np.sin(0.4))})
    found, queries = checked(clearance, (0.0,), (0.8,), budget=64)
    assert (found.binding is None) == free
    assert queries <= 64
    if free:
        assert queries > 4


def bars(apart, hub=None):
    """Return two facing bars, each turning about its end, ``apart`` between the circles of their tips.

    One of them may have a hub: a body that the rotation hardly moves.
    """
    bar = scenes.body("capsule", 0.02, 0.8, xyz=(0.4, 0, 0), rpy=(0.0, np.pi / 2, 0.0))
    plain, hubbed = (
        scenes.urdf([scenes.joint(-1, bodies=bodies)])
        for bodies in ((bar,), (bar, scenes.body("sphere", 0.03)))
    )
    robots = {
        "A": {"urdf": hubbed if hub == 0 else plain, "start": [0.0]},
        "B": {"urdf": hubbed if hub == 1 else plain, "start": [0.0],
              "base": {"xyz": [1.64 + apart, 0, 0], "rpy": [0, 0, np.pi]}},
    }  # fmt: skip
    return Clearance(scenes.build(robots), False)


@pytest.mark.parametrize(("gap", "free"), [(0.0205, True), (0.0195, False)])
@pytest.mark.parametrize("hub", [None, 0, 1])
@pytest.mark.parametrize(("paths", "budget"), [((1.2, 0.02), 60), ((0.02, 1.2), 60), ((1.0, 1.0), 250)])
def test_of_two_rotating_bars_the_longer_path_is_halved(gap, free, paths, budget, hub):
    """If the other path were halved, no budget would be enough."""
    clearance = bars(gap, hub)
    one, other = paths
    hold(clearance, 0, (0.0,))
    hold(clearance, 1, (-other / 2,), (other / 2,))
    found, _ = checked(clearance, (-one / 2,), (one / 2,), budget=budget)
    assert (found.binding is None) == free


# --- cells --------------------------------------------------------------------------------------------------


def test_no_subdivision_recovers_the_distance_lost_to_the_tubes():
    """The loss is the sum of each side's tube times its motion bounds."""
    clearance = two()
    hold(clearance, 0, (-0.5, 0.0))
    hold(clearance, 1, (0.5, 0.0))
    group, k = clearance.find(0, 0)
    mine = clearance.space.sweep_nodes(0, np.array([(-0.5, 0.0)]), np.array([0.01, 0.02]))
    side = clearance.space.sweep_nodes(1, np.array([(0.5, 0.0)]), np.array([0.04, 0.08]))
    assert PairCheck(group, k, 0, mine, LIMIT).loss(side) == pytest.approx(0.15 + MARGIN, abs=1e-15)
    alone = ball({"b": sphere(1.0)})
    group, k = alone.find(0, 0)
    mine = alone.space.sweep_nodes(0, np.zeros((1, 3)), np.array([0.01, 0.02, 0.04]))
    ask = PairCheck(group, k, 0, mine, LIMIT)
    assert ask.moving is None
    assert ask.loss(alone.space.static) == pytest.approx(0.07 + MARGIN, abs=1e-15)


def test_two_arms_of_one_robot_are_checked_at_their_new_position():
    clearance = Clearance(scenes.tree(), False)
    clearance.hold(0, [clearance.space.still(0, (0.0, 0.3, -0.2, -0.3, 0.2))])
    own = [clearance.cell.pairs[pair].kind == "self" for pair in clearance.pairs_of[0]]
    need = np.where(own, clearance.limits_of[0], -10.0)
    one, both = (0.0, -0.7, -0.2, -0.3, 0.2), (0.0, -0.7, -0.2, 0.7, 0.2)
    for q, clear in ((one, True), (both, False)):
        still = clearance.space.still(0, q)
        found = clearance.check(0, still, None, need, Budget(PLENTY))
        assert (found.binding is None) == clear


def test_parts_of_a_chain_are_proven_with_both_bodies_at_the_same_position():
    """The first and the third link of the elbow keep 1 cm on the way; no single direction proves that."""
    clearance = Clearance(scenes.build({"A": {"urdf": scenes.elbow(), "start": [0.0] * 4}}), False)
    clearance._n[:] = [0.0, 0.0, 1.0]
    chain, budget = clearance.groups[0][0], Budget(PLENTY)
    k = [clearance.names(int(pair)) for pair in chain.ids].index(("A/L0", "A/L2"))
    way = path(clearance, 0, [0.0, 0.55, 2.2, 0.0], [0.0, 0.25, 1.84, 0.0])
    assert clearance._prove(PairCheck(chain, k, 0, way, 0.01), budget).lb == 0.01
    assert PLENTY - budget.left <= 9


def test_both_bodies_of_a_chain_are_checked_at_the_same_time():
    clearance = Clearance(scenes.tree(), False)
    chain, apart = clearance.groups[0][0], clearance.groups[0][1]
    mine = clearance.space.still(0, (0.0,) * 5)
    assert [PairCheck(group, 0, 0, mine, LIMIT).moving for group in (chain, apart)] == [None, apart.other]


@pytest.mark.parametrize(("need", "free"), [(0.0399, True), (0.0401, False)])
def test_a_tube_counts_in_every_cell(need, free):
    clearance = ball({"b": sphere(-0.15, 0.15)})
    tube = np.array([0.0, 0.01, 0.0])
    new = clearance.space.sweep_nodes(0, np.array(BEND), tube)
    budget = Budget(PLENTY)
    found = clearance.check(0, new, None, np.array([need]), budget)
    assert (found.binding is None) == free
    assert PLENTY - budget.left < 50


def test_a_path_in_cells():
    nodes = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 2.0)])
    first, second = segments(nodes)
    assert (first.tolist(), second.tolist()) == (nodes[:2].tolist(), nodes[1:].tolist())
    assert middle(second).tolist() == [[1.0, 1.0]]
    lower, upper = halves(second)
    assert (lower.tolist(), upper.tolist()) == ([[1.0, 0.0], [1.0, 1.0]], [[1.0, 1.0], [1.0, 2.0]])
    (still,) = segments(nodes[:1])
    assert still.tolist() == [[0.0, 0.0]]
    assert [half.tolist() for half in halves(still)] == [[[0.0, 0.0]]]


def test_witness_points_are_in_the_order_of_their_pair():
    clearance = two()
    points = ((1.0, 0.0, 0.0), (2.0, 0.0, 0.0))
    assert in_pair_order(*clearance.find(0, 0), points) == points
    assert in_pair_order(*clearance.find(1, 0), points) == points[::-1]
    assert in_pair_order(*clearance.find(1, 0), None) is None
