"""Directions of the axes: comparison of the flange in RIst with the model's flange."""

import math
import re
from collections.abc import Callable
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from armgate.cell.placement import Placement
from armgate.events import Joints
from armgate.links.rsi.setup import Setup

FlangeInFoot = Callable[[ArrayLike], Placement]
"""Function from joint positions (rad, m) to the flange in the arm's foot, which a KRC calls ROBROOT."""

_NEAR = 2.0
"""Largest distance between RIst and the model's flange at which they agree, mm."""
_LEVER = 100.0
"""Length by which a rotation of the flange is multiplied, mm: the last axis only rotates the flange."""
_SAMPLES = 16
_RIST = re.compile(rb"<RIst ([^>]*)>")
_VALUE = re.compile(rb'([XYZABC])="([-+.0-9]{1,32})"')


class AxisDirections:
    """Comparison of RIst with the model at many positions.

    Args:
        setup: Robot and KRC.
        flange: The model's flange.
    """

    def __init__(self, setup: Setup, flange: FlangeInFoot) -> None:
        self._setup, self._flange = setup, flange
        self._samples: list[tuple[Joints, Placement]] = []

    def take(self, q: Joints, data: bytes) -> None:
        """Take a telegram's position, and its RIst if it has one."""
        place = _rist(data)
        if place is not None:
            self._samples.append((q, place))

    def report(self) -> tuple[str, str | None]:
        """Return a line about the comparison, and the problem if there is one."""
        if not any(place.t.any() for _, place in self._samples):
            return "RIst: not sent or all zero; the signs of the axes cannot be compared", None
        turning = [index for index, axis in enumerate(self._setup.axes) if not axis.linear]
        errors = {signs: self._error(turning, signs) for signs in product((1.0, -1.0), repeat=len(turning))}
        own = errors[(1.0,) * len(turning)]
        line = f"RIst: {own:.1f} mm from the model's flange (expected 0, with $BASE and $TOOL zero)"
        if own <= _NEAR:
            alike = sum(error <= _NEAR for error in errors.values()) - 1
            more = f"; {alike} other choice(s) of signs would fit here too: jog all axes away from zero"
            return line + (more if alike else ""), None
        return line, self._problem(turning, errors)

    def _problem(self, turning: list[int], errors: dict[tuple[float, ...], float]) -> str:
        best = min(errors, key=lambda signs: (errors[signs] > _NEAR, signs.count(-1.0)))
        if errors[best] > _NEAR:
            return (
                "RIst does not fit the model with any signs: another robot, or $BASE and $TOOL are not zero"
            )
        names = [self._setup.axes[index].name for index in turning]
        turned = ", ".join(name for name, sign in zip(names, best, strict=True) if sign < 0.0)
        return f"the model fits RIst if {turned} turn(s) the other way: make received and sent negative"

    def _error(self, turning: list[int], signs: tuple[float, ...]) -> float:
        """Return the largest distance of the model's flange from RIst if the axes turn with these signs, mm.

        Rotations count from the first sample on: models differ in how they orient a flange.
        """
        factors = np.ones(len(self._setup.axes))
        factors[turning] = signs
        samples = self._samples[:: max(len(self._samples) // _SAMPLES, 1)]
        places = [(self._flange(factors * q), place) for q, place in (*samples, self._samples[-1])]
        first, first_given = places[0]
        worst = 0.0
        for own, given in places:
            turned = own.R @ first.R.T - given.R @ first_given.R.T
            apart = 1000.0 * float(np.linalg.norm(own.t - given.t))
            worst = max(worst, apart, _LEVER * float(np.linalg.norm(turned)) / math.sqrt(2.0))
        return worst


def _rist(data: bytes) -> Placement | None:
    found = _RIST.search(data)
    values = {name: float(value) for name, value in _VALUE.findall(found[1])} if found else {}
    if len(values) != 6:
        return None
    xyz = [0.001 * values[name] for name in (b"X", b"Y", b"Z")]
    # A, B, C are rotations about z, y, x in this order: URDF's yaw, pitch, roll.
    return Placement.from_rpy(xyz, [math.radians(values[name]) for name in (b"C", b"B", b"A")])
