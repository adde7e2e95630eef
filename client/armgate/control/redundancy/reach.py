"""Controllers that move a task to a target: q̇ from the error, by one of the inverses (slides 10-13, 38-42).

    ẋ = gain · error, limited to a speed
    q̇ = J^# ẋ + (I − J⁺J) q̇₀,   J^# the pseudoinverse, a damped inverse or the transpose

The transpose's q̇ = Jᵀẋ follows the gradient of ½‖error‖²: it needs no inverse and always ends where
Jᵀ·error = 0, but its path bends, and it is slow along short axes of the velocity ellipsoid.

A joint at a limit is locked if q̇ would push against the limit: its column of J becomes zero, and q̇ is
computed again, so that the other joints take over its part. If it were only clamped, its part would be
missing.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Generic, TypeVar, assert_never

import numpy as np
from numpy.typing import ArrayLike

from armgate.control.redundancy.inverses import damped_inverse, pseudoinverse, variably_damped_inverse
from armgate.control.redundancy.objectives import Objective, wanted_velocity
from armgate.control.redundancy.resolution import null_space_part
from armgate.control.redundancy.spaces import Array
from armgate.control.redundancy.tasks import Task

P = TypeVar("P")

AT_LIMIT = 5e-3
"""Distance below which a joint is at its limit, rad or m."""


class Method(Enum):
    """Inverse that gives q̇ from ẋ."""

    PSEUDO = "pseudo"
    DAMPED = "damped"
    VARIABLE = "variable"
    TRANSPOSE = "transpose"


@dataclass(frozen=True, slots=True)
class Tuning:
    """Parameters of a controller.

    Attributes:
        method: the inverse.
        gain: ẋ per error, 1/s. A loop of period T is stable below 2/T, the transpose's below 2/(T σ_max²).
        speed: largest ‖ẋ‖, m/s and rad/s.
        damping: k, or k_max of the variable damping, in the unit of J.
        threshold: σ_min below which the variable damping begins.
    """

    method: Method = Method.DAMPED
    gain: float = 2.0
    speed: float = 0.25
    damping: float = 0.05
    threshold: float = 0.1

    def __post_init__(self) -> None:
        for name in ("gain", "speed", "damping", "threshold"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"expected a {name} > 0, got {getattr(self, name)}")


@dataclass(frozen=True, slots=True, eq=False)
class ReachVelocity:
    """Result of the controller at one position.

    Attributes:
        qd: q̇ (n,), rad/s or m/s, not yet limited to the joints' bounds.
        error: remaining error, (m,), m and rad.
    """

    qd: Array
    error: Array


class Reach(Generic[P]):
    """Controller that moves a task to a target and lowers potentials in its null space.

    Args:
        task: The task.
        target: Target pose.
        tuning: Parameters of the controller.
        objectives: Null-space objectives, each with its gain.
        limits: Lower and upper joint limits (n,) at which joints are locked; by default those of the model.
    """

    def __init__(
        self,
        task: Task[P],
        target: P,
        tuning: Tuning | None = None,
        objectives: Sequence[tuple[Objective, float]] = (),
        limits: tuple[Array, Array] | None = None,
    ) -> None:
        self.task = task
        self.target = target
        self.tuning = Tuning() if tuning is None else tuning
        self._objectives = tuple(objectives)
        self._inverse = _inverse(self.tuning)
        self._lower, self._upper = limits or (task.model.lower, task.model.upper)

    def velocity(self, q: ArrayLike) -> ReachVelocity:
        """Return q̇ at q (n,)."""
        q = np.asarray(q, dtype=np.float64)
        J = self.task.jacobian(q)
        error = self.task.error(q, self.target)
        xd = self.tuning.gain * error
        xd *= min(1.0, self.tuning.speed / max(float(np.linalg.norm(xd)), 1e-12))
        wanted = wanted_velocity(self._objectives, q)
        low, high = q <= self._lower + AT_LIMIT, q >= self._upper - AT_LIMIT
        free = np.ones(len(q), dtype=bool)
        while True:
            # Rounding must not move locked joints, nor prevent termination.
            qd = np.where(free, self._resolve(J * free, xd, wanted * free), 0.0)
            pushed = (low & (qd < 0.0)) | (high & (qd > 0.0))
            if not pushed.any():
                return ReachVelocity(qd, error)
            free &= ~pushed

    def _resolve(self, J: Array, xd: Array, wanted: Array) -> Array:
        qd = self._inverse(J) @ xd
        return qd + null_space_part(J, wanted) if self._objectives else qd


def _inverse(tuning: Tuning) -> Callable[[Array], Array]:
    match tuning.method:
        case Method.PSEUDO:
            return pseudoinverse
        case Method.DAMPED:
            return lambda J: damped_inverse(J, tuning.damping)
        case Method.VARIABLE:
            return lambda J: variably_damped_inverse(J, tuning.threshold, tuning.damping)
        case Method.TRANSPOSE:
            return np.transpose
        case _:
            assert_never(tuning.method)
