"""Measures of a Jacobian's distance from a singularity (slides 19-22)."""

import math

import numpy as np
from numpy.typing import ArrayLike

from armgate.control.redundancy.spaces import Array, matrix


def singular_values(J: ArrayLike) -> Array:
    """Return the singular values of J (m, n), in descending order, (min(m, n),).

    They are the *square roots* of the eigenvalues of JJᵀ; slide 18 equates them.
    """
    return np.asarray(np.linalg.svd(matrix(J), compute_uv=False), dtype=np.float64)


def manipulability(J: ArrayLike) -> float:
    """Return w = √det(JJᵀ), the product of the singular values (slide 19; Yoshikawa 1985).

    Proportional to the volume of the velocity ellipsoid, whose semi-axes have these lengths. With more rows
    than joints it is √det(JᵀJ), since det(JJᵀ) is zero everywhere.
    """
    return float(np.prod(singular_values(J)))


def condition_number(J: ArrayLike) -> float:
    """Return σ_max / σ_min ≥ 1, the eccentricity of the velocity ellipsoid (slide 21); inf if singular."""
    sigma = singular_values(J)
    return float(sigma[0] / sigma[-1]) if sigma[-1] > 0.0 else math.inf


def isotropy(J: ArrayLike) -> float:
    """Return σ_min / σ_max in [0, 1]: 1 if the ellipsoid is a sphere (slide 22), 0 in a singularity."""
    sigma = singular_values(J)
    return float(sigma[-1] / sigma[0]) if sigma[0] > 0.0 else 0.0
