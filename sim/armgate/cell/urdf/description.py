"""Content of a robot description after reading: one tree of links, with joints and collision bodies."""

import math
from dataclasses import dataclass
from typing import Literal

from armgate.cell.placement import Placement
from armgate.cell.shapes import Shape

JointKind = Literal["revolute", "prismatic", "fixed"]


@dataclass(frozen=True)
class UrdfJoint:
    """Joint with its limits in rad or m, per s and per s².

    Attributes:
        name: Name of the joint.
        kind: Kind of the joint.
        parent: Name of the parent link.
        child: Name of the child link.
        origin: Frame of the joint in the frame of the parent link.
        axis: Unit vector of the axis in the frame of the joint.
        lower: Lower limit.
        upper: Upper limit.
        velocity: Largest speed.
        acceleration: Largest acceleration; inf if the description has none.
        deceleration: Largest deceleration; inf if the description has none.
    """

    name: str
    kind: JointKind
    parent: str
    child: str
    origin: Placement
    axis: tuple[float, float, float]
    lower: float
    upper: float
    velocity: float
    acceleration: float = math.inf
    deceleration: float = math.inf


@dataclass(frozen=True)
class UrdfBody:
    """Collision body, placed in the frame of its link."""

    name: str
    link: str
    shape: Shape
    placement: Placement


@dataclass(frozen=True)
class Urdf:
    """Robot description: one tree of links."""

    name: str
    root: str
    links: tuple[str, ...]
    joints: tuple[UrdfJoint, ...]
    bodies: tuple[UrdfBody, ...]
