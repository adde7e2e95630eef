"""Kept bounds: a pair of two robots is one pair, whoever writes it."""

import numpy as np

from armgate.gate.clearance.kept_bounds import KeptBounds


def three():
    """Pairs 3 and 1 are shared by the first two robots, 5 by the last two; 0, 2 and 6 are one's own."""
    return KeptBounds([np.array(ids, dtype=np.intp) for ids in ([0, 3, 1], [1, 5, 3, 2], [5, 6], [])])


def test_nothing_is_known_at_first():
    bounds = three()
    assert all(np.all(np.isneginf(bounds.of(k))) for k in range(4))
    assert [len(bounds.of(k)) for k in range(4)] == [3, 4, 2, 0]


def test_what_one_robot_writes_the_others_read():
    bounds = three()
    bounds.put(0, np.array([0.5, 3.5, 1.5]))
    assert bounds.of(0).tolist() == [0.5, 3.5, 1.5]
    assert bounds.of(1).tolist() == [1.5, -np.inf, 3.5, -np.inf]
    bounds.put(1, np.array([1.0, 5.0, 3.0, 2.0]))
    assert bounds.of(0).tolist() == [0.5, 3.0, 1.0]
    assert bounds.of(2).tolist() == [5.0, -np.inf]
    assert [bounds[p] for p in (0, 1, 2, 3, 5)] == [0.5, 1.0, 2.0, 3.0, 5.0]


def test_one_pair_is_written_everywhere():
    bounds = three()
    bounds[3] = 0.25
    assert bounds[3] == bounds.of(0)[1] == bounds.of(1)[2] == 0.25
    assert sum(np.isfinite(bounds.of(k)).sum() for k in range(4)) == 2


def test_lowering_keeps_the_lower_of_both_and_tells_it_to_the_others():
    bounds = three()
    bounds.put(1, np.array([1.0, 5.0, 3.0, 2.0]))
    bounds.lower(0, np.array([-1.0, 7.0, 0.5]))
    assert bounds.of(0).tolist() == [-np.inf, 3.0, 0.5]
    assert bounds.of(1).tolist() == [0.5, 5.0, 3.0, 2.0]


def test_who_shares_what_with_whom():
    bounds = three()
    ids = ([0, 3, 1], [1, 5, 3, 2], [5, 6], [])
    seen = {}
    for robot in range(4):
        for other, here, there in bounds.shared(robot):
            assert [ids[robot][k] for k in here] == [ids[other][k] for k in there]
            seen[robot, other] = {ids[robot][k] for k in here}
    assert seen == {(0, 1): {1, 3}, (1, 0): {1, 3}, (1, 2): {5}, (2, 1): {5}}


def test_who_shares_nothing_writes_its_own_alone():
    bounds = KeptBounds([np.array(ids, dtype=np.intp) for ids in ([0, 1], [2, 3], [])])
    bounds.put(0, np.array([0.5, 1.5]))
    bounds.put(1, np.array([2.5, 3.5]))
    bounds.put(2, np.zeros(0))
    assert [bounds.of(k).tolist() for k in range(3)] == [[0.5, 1.5], [2.5, 3.5], []]
