"""Range and null spaces of a Jacobian (slides 3-9 and 28-36), from its singular value decomposition.

    J = U Σ Vᵀ,   rank r = number of σ_i that are not zero

    R(J)   the task velocities that some q̇ gives      first r columns of U
    N(Jᵀ)  the singular directions: no motion, and a force needs no torque    the rest of U
    R(Jᵀ)  the joint velocities that move the task, the torques of forces    first r columns of V
    N(J)   the self-motions, the torques that no force causes    the rest of V

N(J) is orthogonal to R(Jᵀ), and N(Jᵀ) to R(J).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

TOLERANCE = 1e-9
"""Share of the largest singular value below which a singular value counts as zero."""


@dataclass(frozen=True, slots=True, eq=False)
class Spaces:
    """Decomposition of one Jacobian J (m, n); all bases are orthonormal columns.

    Attributes:
        U: (m, m).
        sigma: singular values, descending, (min(m, n),).
        V: (n, n).
        rank: number of non-zero singular values.
    """

    U: Array
    sigma: Array
    V: Array
    rank: int

    @property
    def range(self) -> Array:
        """R(J), (m, r)."""
        return self.U[:, : self.rank]

    @property
    def singular_directions(self) -> Array:
        """N(Jᵀ), (m, m − r): the part of the task space that no joint velocity reaches."""
        return self.U[:, self.rank :]

    @property
    def row_space(self) -> Array:
        """R(Jᵀ), (n, r)."""
        return self.V[:, : self.rank]

    @property
    def null(self) -> Array:
        """N(J), (n, n − r)."""
        return self.V[:, self.rank :]

    @property
    def null_projector(self) -> Array:
        """I − J⁺J (n, n), the orthogonal projection onto N(J) (slide 40)."""
        null = self.null
        projector: Array = null @ null.T
        return projector

    @property
    def degree_of_manipulability(self) -> int:
        """Dimension of R(J) (slide 32)."""
        return self.rank

    @property
    def degree_of_redundancy(self) -> int:
        """Dimension of N(J); this and the degree of manipulability add up to n (slide 32)."""
        return len(self.V) - self.rank

    @property
    def singular(self) -> bool:
        """True if rank is lost: det(JJᵀ) = 0 for m ≤ n (slide 7), det(JᵀJ) = 0 for more rows than joints."""
        return self.rank < len(self.sigma)


def spaces(J: ArrayLike, tolerance: float = TOLERANCE) -> Spaces:
    """Decompose J (m, n).

    Args:
        J: the Jacobian. Its rows, and its columns, should have the same unit: the rank does not depend on the
            units, but the singular values, and so the distance to a singularity, depend on them.
        tolerance: singular values below this share of the largest one are zero.

    Raises:
        ValueError: if J is not a matrix of finite numbers.
    """
    U, sigma, Vt = np.linalg.svd(matrix(J))
    rank = int(np.count_nonzero(sigma > tolerance * sigma[0]))
    return Spaces(U, sigma, Vt.T, rank)


def matrix(J: ArrayLike) -> Array:
    """Return J as an array (m, n).

    Raises:
        ValueError: if it is not a matrix of finite numbers with at least one row and one column.
    """
    array = np.asarray(J, dtype=np.float64)
    if array.ndim != 2 or not array.size:
        raise ValueError(f"expected a Jacobian (m, n) of at least one row and column, got {array.shape}")
    if not np.isfinite(array).all():
        raise ValueError("expected a Jacobian of finite numbers, got NaN or infinity in it")
    return array


def vector(values: ArrayLike, length: int, what: str) -> Array:
    """Return values as an array (length,).

    Raises:
        ValueError: if there are more or fewer values; the text names `what`.
    """
    array = np.asarray(values, dtype=np.float64)
    if array.shape != (length,):
        raise ValueError(f"{what} has the shape {array.shape}; expected {length} numbers")
    return array
