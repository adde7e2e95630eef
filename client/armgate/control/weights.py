"""Joint limit weights, equations (10) and (11), with the unit of the angle made explicit.

    H_j = c_j · 8 x / (1 − x²)²,   W⁻¹_jj = 1 / (1 + H_j²),   x = (2 q − q_M − q_m) / (q_M − q_m)   (10), (11)

(11) as printed has the unit 1/angle, so radians and degrees give different controllers: it is H above with
c_j = 2 / (q_M − q_m). Here x is the position in the half range and c_j a number; `LimitRule` lists the
choices.
"""

from __future__ import annotations

from enum import Enum

import numpy as np
from numpy.typing import NDArray

from armgate.cell.model import RobotModel

Vector = NDArray[np.float64]


class LimitRule(Enum):
    """Rule for the weights of joints near their limits.

    Attributes:
        UNIT_FREE: c_j is the same number for all joints; a joint is weighted only while it approaches its
            limit.
        PAPER_RADIANS: (10) and (11) as printed, ranges in rad; joints that leave a limit are weighted, too.
        PAPER_DEGREES: the same with ranges in degrees: weights 57 times weaker.
        CHAN_DUBEY: Chan and Dubey (1995), ranges in rad: H with their factor ¼, W⁻¹ = 1 / (1 + |H|), and only
            while the joint approaches its limit.
    """

    UNIT_FREE = "unit-free"
    PAPER_RADIANS = "paper, rad"
    PAPER_DEGREES = "paper, deg"
    CHAN_DUBEY = "Chan-Dubey"

    @property
    def always(self) -> bool:
        """True if a joint that leaves its limit is weighted like one that approaches it."""
        return self in (LimitRule.PAPER_RADIANS, LimitRule.PAPER_DEGREES)

    def strengths(self, model: RobotModel, c: float) -> Vector:
        """Return c_j, (n,); only UNIT_FREE uses `c`. Ranges of prismatic joints are in m under every rule."""
        span = model.upper - model.lower
        if self is LimitRule.UNIT_FREE:
            return np.full(model.n, c)
        if self is LimitRule.CHAN_DUBEY:
            return np.asarray(0.5 / span)
        turns = np.array([joint.kind == "revolute" for joint in model.joints])
        unit = 180.0 / np.pi if self is LimitRule.PAPER_DEGREES else 1.0
        return np.asarray(2.0 / (span * np.where(turns, unit, 1.0)))


class LimitWeights:
    """Weights W⁻¹ of (10) for the limits `lower` and `upper` ((n,), rad or m).

    Args:
        lower: lower joint limits.
        upper: upper joint limits.
        c: strength, one number or (n,).
        squared: True for 1/(1 + H²) as in (10), False for 1/(1 + |H|).

    Raises:
        ValueError: if a joint has no range (upper ≤ lower), or c ≤ 0.
    """

    def __init__(self, lower: Vector, upper: Vector, c: float | Vector, *, squared: bool = True) -> None:
        if not np.all(upper > lower):
            raise ValueError(f"joint limits need lower < upper, got lower {lower} and upper {upper}")
        if not np.all(np.asarray(c) > 0.0):
            raise ValueError(f"expected a strength c > 0 of the limit weights, got {c}")
        self.slope: Vector = 2.0 / (upper - lower)
        self.offset: Vector = (upper + lower) / (upper - lower)
        self.strength: Vector = 8.0 * np.broadcast_to(np.asarray(c, dtype=np.float64), lower.shape)
        self.squared = squared

    @classmethod
    def of(cls, model: RobotModel, rule: LimitRule, c: float) -> LimitWeights:
        """Return the weights that a rule gives to the joints of a model."""
        squared = rule is not LimitRule.CHAN_DUBEY
        return cls(model.lower, model.upper, rule.strengths(model, c), squared=squared)

    def position(self, q: Vector) -> Vector:
        """Return x: −1 at the lower limit, 0 in the middle, 1 at the upper limit."""
        x: Vector = q * self.slope - self.offset
        return x

    def inverse(self, x: Vector) -> Vector:
        """Return the diagonal of W⁻¹ at the positions x: 1 in the middle, 0 at the limits and beyond.

        1/(1 + H²) or 1/(1 + |H|) is expanded, so that there is no division by zero at a limit.
        """
        xx = x * x
        m = np.maximum(1.0 - xx, 0.0)
        m *= m
        H = self.strength * np.abs(x)
        if self.squared:
            m *= m
            H *= H
        w: Vector = m / (m + H)
        return w

    def directed(self, x: Vector, *, always: bool) -> tuple[Vector, Vector]:
        """Return the diagonals of W⁻¹ at the positions x for joints that go down, and for joints that go up.

        Args:
            x: as in `inverse`.
            always: True to weight joints that leave their limit, too.
        """
        w = self.inverse(x)
        return (w, w) if always else (np.where(x < 0.0, w, 1.0), np.where(x > 0.0, w, 1.0))
