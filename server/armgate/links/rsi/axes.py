"""Axes of a KRC in deg and mm, for the joints of a robot in rad and m."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

A_AXES = ("A1", "A2", "A3", "A4", "A5", "A6")
E_AXES = ("E1", "E2", "E3", "E4", "E5", "E6")
AXES = frozenset((*A_AXES, *E_AXES))


@dataclass(frozen=True, slots=True)
class Axis:
    """Axis of one joint.

    Attributes:
        name: Name of the axis, A1 to A6 or E1 to E6.
        joint: Name of the joint.
        linear: True for a prismatic joint, in m and mm; otherwise rad and deg.
        read: Factor from the KRC's value to rad or m.
        sent: Factor from rad or m to the KRC's value of a correction.
    """

    name: str
    joint: str
    linear: bool
    read: float
    sent: float

    @property
    def unit(self) -> str:
        """Unit in messages to people."""
        return "mm" if self.linear else "deg"

    @property
    def received(self) -> float:
        """Factor ``received`` of the configuration, for values from the KRC."""
        return 1.0 / (self.shown * self.read)

    @property
    def sending(self) -> float:
        """Factor ``sent`` of the configuration, for values to the KRC."""
        return self.sent / self.shown

    @property
    def shown(self) -> float:
        """Factor from rad or m to the unit in messages to people."""
        return 1000.0 if self.linear else math.degrees(1.0)


def axes_of(
    joints: Sequence[tuple[str, bool]], own: Mapping[str, tuple[str, float, float]]
) -> tuple[Axis, ...]:
    """Return the axis of each joint.

    Args:
        joints: Name of each joint, and True if it is prismatic, in the order of the model.
        own: Configured axes: joint, and factors ``received`` and ``sent``, by name of the axis.

    Raises:
        ValueError: A joint does not exist, or there are more joints than axes.
    """
    names = {name for name, _ in joints}
    by_joint = {joint: axis for axis, (joint, _, _) in own.items()}
    if unknown := set(by_joint) - names:
        raise ValueError(f"there is no joint {min(unknown)!r}; expected one of {', '.join(sorted(names))}")
    if len(by_joint) != len(own):
        raise ValueError("two axes name the same joint; expected each joint once")
    free = {True: [n for n in E_AXES if n not in own], False: [n for n in A_AXES if n not in own]}
    found = []
    for joint, linear in joints:
        if joint not in by_joint and not free[linear]:
            raise ValueError(f"{joint}: a KRC has no axis left for it; expected at most 6 joints of its kind")
        name = by_joint.get(joint) or free[linear].pop(0)
        _, received, sent = own.get(name, (joint, 1.0, 1.0))
        unit = 1000.0 if linear else math.degrees(1.0)
        found.append(Axis(name, joint, linear, 1.0 / (unit * received), unit * sent))
    return tuple(found)
