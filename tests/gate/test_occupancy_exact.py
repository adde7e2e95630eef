"""Occupancies by hand: nodes, tubes, and the measurements that they explain."""

import math

import pytest

from armgate.gate.occupancy import Occupancy, deviation, occupancy, settle_measured

A, B, C = (0.0, 0.0), (1.0, 0.0), (1.0, 1.0)
ROUNDING = 1e-9


def test_a_tube_is_the_sum_of_corner_window_and_tolerance():
    """The corner: the middle between A and C is (0.5, 0.5), off B by (0.5, 0.5)."""
    one = occupancy(A, B, C, [], 0.01)
    assert one.nodes == (A, B, C)
    assert one.tube == pytest.approx((0.51, 0.51))
    assert one.end == C
    assert one.segments == [(A, B), (B, C)]
    wide = occupancy(A, B, C, [(0.5, 0.2), (0.25, -0.1)], 0.01)
    assert wide.tube == pytest.approx((0.51, 0.71))


@pytest.mark.parametrize(
    ("past", "off"),
    [
        ((-0.3, 0.1), (0.3, 0.1)),  # before A: distance from A
        ((1.4, -0.2), (0.4, 0.2)),  # beyond B: distance from B
        ((0.7, 0.05), (0.0, 0.05)),
    ],
)
def test_a_setpoint_of_the_window_widens_the_tube_by_its_distance_from_the_chord(past, off):
    assert occupancy(A, B, B, [past], 0.0).tube == pytest.approx(off)


def test_the_corner_is_weighted_by_the_lengths_of_both_segments():
    """A quarter of the path is before the corner."""
    one = occupancy((0.0, 0.0), (1.0, 0.0), (1.0, 3.0), [], 0.0)
    assert one.tube == pytest.approx((0.75, 0.75))
    assert occupancy(A, B, (3.0, 0.0), [], 0.0).tube == pytest.approx((0.0, 0.0))


def test_a_robot_that_stands_still_has_one_node():
    one = occupancy(A, A, A, [], 0.1)
    assert one.nodes == (A,)
    assert one.segments == [(A, A)]
    assert one.tube == (0.1, 0.1)
    assert occupancy(A, A, C, [], 0.0).nodes == occupancy(A, C, C, [], 0.0).nodes == (A, C)
    assert occupancy(A, A, A, [(0.3, -0.2)], 0.0).tube == pytest.approx((0.3, 0.2))


def test_deviation_is_that_of_the_worst_joint_from_the_nearest_segment():
    one = Occupancy((A, B, C), (0.0, 0.0))
    assert deviation((0.5, -0.2), one) == pytest.approx(0.2)
    assert deviation((1.3, 0.5), one) == pytest.approx(0.3)
    assert deviation((1.3, 1.1), one) == pytest.approx(0.3)
    assert deviation((0.25, 0.0), one) == 0.0


WAY = Occupancy((A, B), (0.1, 0.05))
TOLERANCE = 0.02


@pytest.mark.parametrize(
    ("q", "settled"),
    [
        ((0.5, 0.0), (0.5, 0.0)),
        ((0.5, 0.03), (0.5, 0.03)),  # r inside the edge
        ((0.5, 0.04), (0.5, 0.03)),  # moved back inside
        ((0.5, -0.069), (0.5, -0.03)),  # r beyond the edge
        ((0.5, 0.0701), None),
        ((0.5, -0.0701), None),
        ((-0.08, 0.0), (-0.08, 0.0)),
        ((-0.119, 0.0), (-0.08, 0.0)),
        ((-0.1201, 0.0), None),
        ((1.119, 0.01), (1.08, 0.01)),
        ((1.1201, 0.01), None),
    ],
)
def test_a_measurement_at_the_edge_is_moved_inside(q, settled):
    found = settle_measured(q, [WAY], TOLERANCE)
    assert (found is None) == (settled is None)
    if settled is not None:
        assert found == pytest.approx(settled, abs=1e-8)


def test_a_measurement_explained_by_one_of_several_occupancies_is_explained():
    other = Occupancy(((5.0, 5.0),), (0.1, 0.1))
    assert settle_measured((5.05, 5.0), [WAY, other], TOLERANCE) == (5.05, 5.0)
    assert settle_measured((5.11, 5.0), [WAY, other], TOLERANCE) == pytest.approx((5.08, 5.0), abs=1e-8)
    assert settle_measured((5.11, 5.0), [WAY], TOLERANCE) is None
    assert settle_measured((5.13, 5.0), [other, WAY], TOLERANCE) is None


def test_of_several_explanations_the_nearest_is_used():
    """Both positions explain the measurement; with axes that lag differently both would be admissible."""
    here, there = (Occupancy(((x,),), (0.07,)) for x in (0.0, 0.04))
    for q, settled in ((0.025, 0.04), (0.015, 0.0)):
        for held in ([here, there], [there, here]):
            assert settle_measured((q,), held, 0.01, (0.05,)) == pytest.approx((settled,))


def test_all_joints_must_be_within_at_one_point_of_the_path():
    """On the diagonal each joint alone is within the tube at some point, but never both at once."""
    slope = Occupancy(((0.0, 0.0), (1.0, 1.0)), (0.05, 0.05))
    assert settle_measured((0.5, 0.56), [slope], 0.01) is not None
    assert settle_measured((0.2, 0.5), [slope], 0.01) is None
    assert settle_measured((0.56, 0.5), [slope], 0.01) is not None
    back = Occupancy(((1.0, 1.0), (0.0, 0.0)), (0.05, 0.05))
    assert settle_measured((0.5, 0.56), [back], 0.01) is not None
    assert settle_measured((0.2, 0.5), [back], 0.01) is None


def test_rounding_alone_causes_no_fault():
    exact = Occupancy(((0.0,), (1.0,)), (0.0,))
    assert settle_measured((1.0 + 0.5 * ROUNDING,), [exact], 0.0) is not None
    assert settle_measured((1.0 + 1.5 * ROUNDING,), [exact], 0.0) is None
    still = Occupancy(((0.3,),), (0.0,))
    assert settle_measured((0.3,), [still], 0.0) == (0.3,)
    assert settle_measured((0.3 + 3 * ROUNDING,), [still], 0.0) is None
    assert settle_measured((math.nextafter(0.3, 1.0),), [still], 0.0) is not None


def test_a_tube_does_not_depend_on_the_position_of_the_path():
    shift = (3.0, -2.0)
    a, b, c = (tuple(x + d for x, d in zip(p, shift, strict=True)) for p in (A, B, (1.0, 3.0)))
    assert occupancy(a, b, c, [], 0.0).tube == pytest.approx((0.75, 0.75))


def test_a_measurement_exactly_at_the_edge_is_inside():
    edge = 0.25 - ROUNDING
    for q in (1.25, -0.25):
        assert settle_measured((q,), [Occupancy(((0.0,), (1.0,)), (edge,))], 0.0) == (q,)
    for q in (0.25, -0.25):
        assert settle_measured((q,), [Occupancy(((0.0,),), (edge,))], 0.0) == (q,)


def test_a_path_shorter_than_the_rounding_counts_with_its_length():
    short = Occupancy(((0.0,), (0.5 * ROUNDING,)), (0.0,))
    assert settle_measured((1.4 * ROUNDING,), [short], 0.0) is not None
    assert settle_measured((1.6 * ROUNDING,), [short], 0.0) is None
