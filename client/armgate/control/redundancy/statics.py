"""Statics: joint torques and the forces that they balance, τ = JᵀF (slides 34-36).

By virtual work, τᵀq̇ = Fᵀẋ for every q̇. So null spaces of motion are range spaces of forces:

    R(Jᵀ) = N(J)⊥    a force makes no torque along a self-motion (slide 36)
    N(Jᵀ) = R(J)⊥    a force in a singular direction is held by the structure, without torque

`armgate.control.redundancy.spaces` gives all four.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from armgate.control.redundancy.inverses import pseudoinverse
from armgate.control.redundancy.spaces import TOLERANCE, Array, matrix, vector


def torques(J: ArrayLike, force: ArrayLike) -> Array:
    """Return τ = JᵀF (n,), the joint torques [Nm, or N of prismatic joints] of the task force F (m,).

    Raises:
        ValueError: if F does not fit J.
    """
    J = matrix(J)
    tau: Array = J.T @ vector(force, J.shape[0], "the force")
    return tau


@dataclass(frozen=True, slots=True, eq=False)
class Balance:
    """Decomposition of joint torques τ.

    Attributes:
        force: F (m,): the smallest force with JᵀF as near to τ as possible.
        inner: τ − JᵀF (n,), in N(J): it accelerates self-motions, and no task force balances it.
    """

    force: Array
    inner: Array


def balance(J: ArrayLike, tau: ArrayLike, tolerance: float = TOLERANCE) -> Balance:
    """Split joint torques τ (n,) into the part that a task force balances and the rest.

    Raises:
        ValueError: if τ does not fit J.
    """
    J = matrix(J)
    tau = vector(tau, J.shape[1], "τ")
    force: Array = pseudoinverse(J, tolerance).T @ tau
    return Balance(force, np.asarray(tau - J.T @ force))
