"""Kept bounds: a pair of two robots has one bound, in the rows of both."""

import numpy as np

from armgate.gate.clearance.pair_bounds import PairBounds


def three():
    """Return bounds of three robots: two share pairs 3 and 1, two share 5; 0, 2 and 6 are not shared."""
    return PairBounds([np.array(ids, dtype=np.intp) for ids in ([0, 3, 1], [1, 5, 3, 2], [5, 6], [])])


def test_all_bounds_are_minus_infinity_at_first():
    bounds = three()
    assert all(np.all(np.isneginf(bounds.of(k))) for k in range(4))
    assert [len(bounds.of(k)) for k in range(4)] == [3, 4, 2, 0]


def test_bounds_written_for_one_robot_are_read_for_the_others():
    bounds = three()
    bounds.put(0, np.array([0.5, 3.5, 1.5]))
    assert bounds.of(0).tolist() == [0.5, 3.5, 1.5]
    assert bounds.of(1).tolist() == [1.5, -np.inf, 3.5, -np.inf]
    bounds.put(1, np.array([1.0, 5.0, 3.0, 2.0]))
    assert bounds.of(0).tolist() == [0.5, 3.0, 1.0]
    assert bounds.of(2).tolist() == [5.0, -np.inf]
    assert [bounds[p] for p in (0, 1, 2, 3, 5)] == [0.5, 1.0, 2.0, 3.0, 5.0]


def test_a_bound_of_one_pair_is_written_to_all_rows():
    bounds = three()
    bounds[3] = 0.25
    assert bounds[3] == bounds.of(0)[1] == bounds.of(1)[2] == 0.25
    assert sum(np.isfinite(bounds.of(k)).sum() for k in range(4)) == 2


def test_lowering_keeps_the_lower_bound_in_the_rows_of_all_robots():
    bounds = three()
    bounds.put(1, np.array([1.0, 5.0, 3.0, 2.0]))
    bounds.lower(0, np.array([-1.0, 7.0, 0.5]))
    assert bounds.of(0).tolist() == [-np.inf, 3.0, 0.5]
    assert bounds.of(1).tolist() == [0.5, 5.0, 3.0, 2.0]


def test_shared_returns_the_indices_of_shared_pairs_in_both_rows():
    bounds = three()
    ids = ([0, 3, 1], [1, 5, 3, 2], [5, 6], [])
    seen = {}
    for robot in range(4):
        for other, here, there in bounds.shared(robot):
            assert [ids[robot][k] for k in here] == [ids[other][k] for k in there]
            seen[robot, other] = {ids[robot][k] for k in here}
    assert seen == {(0, 1): {1, 3}, (1, 0): {1, 3}, (1, 2): {5}, (2, 1): {5}}


def test_a_robot_without_shared_pairs_writes_only_its_own_row():
    bounds = PairBounds([np.array(ids, dtype=np.intp) for ids in ([0, 1], [2, 3], [])])
    bounds.put(0, np.array([0.5, 1.5]))
    bounds.put(1, np.array([2.5, 3.5]))
    bounds.put(2, np.zeros(0))
    assert [bounds.of(k).tolist() for k in range(3)] == [[0.5, 1.5], [2.5, 3.5], []]
