"""Which names a robot, link, joint, frame or body may have: the ones that the protocol can carry."""

import re

NAME = r"^[A-Za-z0-9_.:-]{1,64}$"
"""No slash: that separates a robot's name from its body's in ``FR/link_3``, and parts in ``gripper/2``."""

MAX_NAME = 64
"""Longest name of any kind, also of ``robot/body``."""

NAME_TEXT = f"1 to {MAX_NAME} letters, digits, or any of _ . : -"

_NAME = re.compile(NAME)
_PART = re.compile(NAME.replace("{1,64}$", "{1,64}(?:/[1-9][0-9]*)?$"))


def is_name(text: str) -> bool:
    """Whether this may be a name."""
    return _NAME.fullmatch(text) is not None


def is_part_name(text: str) -> bool:
    """Whether this may be the name of a body, or of one of the convex parts that a mesh was cut into."""
    return len(text) <= MAX_NAME and _PART.fullmatch(text) is not None


def part_name(whole: str, number: int, count: int) -> str:
    """Name of one of the ``count`` parts of a body, counted from 1; the only part keeps the body's name."""
    return whole if count == 1 else f"{whole}/{number}"


def whole_name(part: str) -> str:
    """Name of the body that a part belongs to: ``gripper`` for ``gripper/2`` and for ``gripper``."""
    return part.partition("/")[0]
