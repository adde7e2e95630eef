"""Proximity of the leader: the gate's nearest pairs of bodies, as arguments of the control law."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from armgate.cell.model import RobotModel
from armgate.client import Entry, Nearest
from armgate.control.near_bodies import NearPair, approach

NEAR = 0.15
"""Margin beyond which a pair does not matter for the next increments, m."""


@dataclass(frozen=True)
class RobotBodies:
    """Model of one of the two robots, and its bodies by name.

    Attributes:
        model: Model of the robot.
        bodies: Indices of its bodies by their names in the cell (``FR/link_2``).
    """

    model: RobotModel
    bodies: Mapping[str, int]

    @classmethod
    def of(cls, robot: str, model: RobotModel) -> "RobotBodies":
        """Return the bodies of the robot with this name and model."""
        return cls(model, {f"{robot}/{body.name}": index for index, body in enumerate(model.bodies)})


@dataclass(frozen=True)
class Proximity:
    """Pairs of follower and leader bodies, from the gate's nearest pairs of the follower.

    Attributes:
        own: Bodies of the follower.
        other: Bodies of the leader.
    """

    own: RobotBodies
    other: RobotBodies

    def pairs(self, own: Entry, other: Entry) -> tuple[NearPair, ...]:
        """Return the near pairs, with the margins after a stop of the leader; () if positions are unknown."""
        close = [near for near in own.nearest or () if near.distance - near.limit < NEAR]
        if not close or other.q is None or not other.stop_end:
            return ()
        q, end = np.array(other.q), np.array(other.stop_end)
        found = (self._pair(near, q, end) for near in close)
        return tuple(pair for pair in found if pair is not None)

    def _pair(self, near: Nearest, q: np.ndarray, end: np.ndarray) -> NearPair | None:
        """Return the pair; None unless it has witness points, a moving own body and one of the leader's."""
        if near.points is None:
            return None
        (first, second), points = near.pair, np.array(near.points)
        if first not in self.own.bodies:
            first, second, points = second, first, points[::-1]
        mine, theirs = self.own.bodies.get(first), self.other.bodies.get(second)
        if mine is None or theirs is None or self.own.model.bodies[mine].joint < 0:
            return None
        comes = approach(self.other.model, theirs, q, end, points[1], points[0])
        return NearPair(points, self.own.model.bodies[mine].joint, near.distance - near.limit - comes)
