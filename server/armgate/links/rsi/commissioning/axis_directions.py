"""Whether the axes turn as the joints of the model do: the flange as RIst has it, against the model's."""

import math
import re
from collections.abc import Callable
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from armgate.cell.placement import Placement
from armgate.events import Joints
from armgate.links.rsi.setup import Setup

Foot = Callable[[ArrayLike], Placement]
"""From joint positions (rad, m) to the flange in the arm's foot, which a KRC calls ROBROOT."""

_NEAR = 2.0
"""RIst and the model's flange are the same if they are no farther apart, mm."""
_LEVER = 100.0
"""Where on the flange turning counts as so many mm: the last axis moves nothing else."""
_SAMPLES = 16
_RIST = re.compile(rb"<RIst ([^>]*)>")
_VALUE = re.compile(rb'([XYZABC])="([-+.0-9]{1,32})"')


class AxisDirections:
    """Gathers positions and what RIst says of them.

    Args:
        setup: What the cell says of robot and KRC.
        foot: The model's flange.
    """

    def __init__(self, setup: Setup, foot: Foot) -> None:
        self._setup, self._foot = setup, foot
        self._samples: list[tuple[Joints, Placement]] = []

    def take(self, q: Joints, data: bytes) -> None:
        """A telegram, and the position in it."""
        place = _rist(data)
        if place is not None:
            self._samples.append((q, place))

    def report(self) -> tuple[str, str | None]:
        """A line about it, and what is wrong, if anything is."""
        if not any(place.t.any() for _, place in self._samples):
            return "RIst: not sent or all zero; the signs of the axes cannot be compared", None
        turning = [index for index, axis in enumerate(self._setup.axes) if not axis.linear]
        errors = {signs: self._error(turning, signs) for signs in product((1.0, -1.0), repeat=len(turning))}
        own = errors[(1.0,) * len(turning)]
        line = f"RIst: {own:.1f} mm from the model's flange (expected 0, with $BASE and $TOOL zero)"
        if own <= _NEAR:
            alike = sum(error <= _NEAR for error in errors.values()) - 1
            more = f"; {alike} other choice(s) of signs would fit here too: jog all axes off zero"
            return line + (more if alike else ""), None
        best = min(errors, key=lambda signs: (errors[signs] > _NEAR, signs.count(-1.0)))
        if errors[best] > _NEAR:
            return line, (
                "RIst does not fit the model with any signs: another robot, or $BASE and $TOOL are not zero"
            )
        names = [self._setup.axes[index].name for index in turning]
        turned = ", ".join(name for name, sign in zip(names, best, strict=True) if sign < 0.0)
        return line, f"the model fits RIst if {turned} turn(s) the other way: make received and sent negative"

    def _error(self, turning: list[int], signs: tuple[float, ...]) -> float:
        """How far the model's flange is from RIst at worst, if axes turned with these signs, mm.

        Turning counts from the first sample on: models differ in how they call a flange's directions.
        """
        factors = np.ones(len(self._setup.axes))
        factors[turning] = signs
        samples = self._samples[:: max(len(self._samples) // _SAMPLES, 1)]
        places = [(self._foot(factors * q), place) for q, place in (*samples, self._samples[-1])]
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
    # A, B, C turn about z, y, x, one after the other: URDF's yaw, pitch, roll.
    return Placement.from_rpy(xyz, [math.radians(values[name]) for name in (b"C", b"B", b"A")])
