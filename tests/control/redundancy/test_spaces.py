import numpy as np
import pytest

from armgate.control.redundancy.spaces import spaces


def test_bases_are_orthonormal_and_span_their_spaces(J):
    found = spaces(J)
    m, n = J.shape
    for basis, dimension in [
        (found.range, found.rank),
        (found.singular_directions, m - found.rank),
        (found.row_space, found.rank),
        (found.null, n - found.rank),
    ]:
        assert basis.shape[1] == dimension
        np.testing.assert_allclose(basis.T @ basis, np.eye(dimension), atol=1e-12)
    assert found.rank == np.linalg.matrix_rank(J)
    np.testing.assert_allclose(J @ found.null, 0.0, atol=1e-12)
    np.testing.assert_allclose(J.T @ found.singular_directions, 0.0, atol=1e-12)
    np.testing.assert_allclose(found.range @ found.range.T @ J, J, atol=1e-12)
    np.testing.assert_allclose(found.row_space.T @ found.null, 0.0, atol=1e-12)


def test_degrees_add_up_to_the_joints(J):
    """Slide 32."""
    found = spaces(J)
    assert found.degree_of_manipulability + found.degree_of_redundancy == J.shape[1]
    assert found.singular == (found.rank < min(J.shape))


def test_null_projector(J):
    found = spaces(J)
    P = found.null_projector
    np.testing.assert_allclose(P @ P, P, atol=1e-12)
    np.testing.assert_allclose(P, P.T, atol=1e-15)
    np.testing.assert_allclose(P, np.eye(J.shape[1]) - np.linalg.pinv(J) @ J, atol=1e-10)


def test_a_robot_that_cannot_move_the_task_stands_still():
    found = spaces(np.zeros((2, 3)))
    assert (found.rank, found.singular, found.degree_of_redundancy) == (0, True, 3)


def test_tolerance_is_relative_to_the_largest_singular_value():
    J = np.diag([1e-6, 1e-12])
    assert spaces(J).rank == 2
    assert spaces(J, tolerance=1e-5).rank == 1
    assert spaces(1e9 * J, tolerance=1e-5).rank == 1


@pytest.mark.parametrize("bad", [np.zeros(3), np.zeros((0, 3)), [[np.nan, 1.0]], [[np.inf]]])
def test_a_value_that_is_not_a_matrix_is_refused(bad):
    with pytest.raises(ValueError, match="expected a Jacobian"):
        spaces(bad)
