"""Where the leader is near: the pairs of bodies that the gate tells of, as the control law takes them."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from armgate.cell.model import RobotModel
from armgate.client import Entry, Nearest
from armgate.control.near_bodies import NearPair, approach

NEAR = 0.15
"""Pairs that have more room than this, m, do not matter in the next increments."""


@dataclass(frozen=True)
class RobotBodies:
    """One of the two robots.

    Attributes:
        model: Its model.
        bodies: Its bodies' indices by their names in the cell (``FR/link_2``).
    """

    model: RobotModel
    bodies: Mapping[str, int]

    @classmethod
    def of(cls, robot: str, model: RobotModel) -> "RobotBodies":
        """The robot of this name and model."""
        return cls(model, {f"{robot}/{body.name}": index for index, body in enumerate(model.bodies)})


@dataclass(frozen=True)
class Proximity:
    """Finds the pairs of follower and leader in what the gate tells of the follower.

    Attributes:
        own: The follower.
        other: The leader.
    """

    own: RobotBodies
    other: RobotBodies

    def pairs(self, own: Entry, other: Entry) -> tuple[NearPair, ...]:
        """The near pairs with what room the leader's stop leaves them; none where positions are not known."""
        if other.q is None or not other.stop_end or own.nearest is None:
            return ()
        q, end = np.array(other.q), np.array(other.stop_end)
        found = (self._pair(near, q, end) for near in own.nearest if near.distance - near.limit < NEAR)
        return tuple(pair for pair in found if pair is not None)

    def _pair(self, near: Nearest, q: np.ndarray, end: np.ndarray) -> NearPair | None:
        """None but for a moving body and one of the leader's whose nearest points an engine has told."""
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
