"""Parameters of the camera law."""

from __future__ import annotations

from dataclasses import dataclass
from math import radians

from armgate.control.weights import LimitRule


@dataclass(frozen=True, slots=True)
class Gains:
    """Gains and ranges of the camera law; the letters are the paper's.

    Time in the law is virtual: in each tick the law is integrated as far as the increment bound allows, so
    only the ratios of the gains matter, not their size.

    Attributes:
        task: k_p of (9), 1/s.
        distance: k of (14), joint speed per metre of distance error and per m/rad of lever, rad²/(s·m²).
        roll: k_c of (15), 1/s.
        repulsion: η, the strength of (12). The paper uses 1, with other radii.
        reach: ρ0 of (12), m. Bounding spheres further apart than this do not repel.
        own_repulsion: η between spheres of the robot's own segments.
        own_reach: ρ0 between them, m.
        contact: lower bound of d in (12), m: a pair that touches or overlaps is pushed apart by a finite
            force.
        push: largest force of a pair of spheres, in the unit of φ(d) in (12).
        limits: rule that weights joints near their limits.
        limit: c of the unit-free rule.
        roll_fade: the roll control fades out between these angles of the view axis from the vertical, rad.
        emergency_on: (13) replaces (9) when an obstacle or the floor is nearer to a sphere than this, m.
        emergency_off: (9) is used again when all obstacles and the floor are farther away than this, m.
    """

    task: float = 5.0
    distance: float = 5.0
    roll: float = 5.0
    repulsion: float = 0.01
    reach: float = 0.3
    own_repulsion: float = 0.0004
    own_reach: float = 0.1
    contact: float = 0.02
    push: float = 20.0
    limits: LimitRule = LimitRule.UNIT_FREE
    limit: float = 0.02
    roll_fade: tuple[float, float] = (radians(5.0), radians(15.0))
    emergency_on: float = 0.03
    emergency_off: float = 0.10
