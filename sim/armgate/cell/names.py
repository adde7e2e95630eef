"""Names of robots, links, joints, frames and bodies: the names that the protocol allows."""

import re

NAME = r"^[A-Za-z0-9_.:-]{1,64}$"
"""Pattern of a name. A slash separates robot and body (``FR/link_3``) and numbers parts (``gripper/2``)."""

MAX_NAME = 64
"""Largest length of any name, also of ``robot/body``."""

NAME_TEXT = f"1 to {MAX_NAME} letters, digits, or any of _ . : -"
"""Description of a name for error messages."""

_NAME = re.compile(NAME)
_PART = re.compile(NAME.replace("{1,64}$", "{1,64}(?:/[1-9][0-9]*)?$"))


def is_name(text: str) -> bool:
    """Return True if a text is a valid name."""
    return _NAME.fullmatch(text) is not None


def is_part_name(text: str) -> bool:
    """Return True if a text is a valid name of a body, or of a convex part that a mesh was cut into."""
    return len(text) <= MAX_NAME and _PART.fullmatch(text) is not None


def part_name(whole: str, number: int, count: int) -> str:
    """Return the name of one of ``count`` parts of a body, counted from 1; a single part has the body's."""
    return whole if count == 1 else f"{whole}/{number}"


def whole_name(part: str) -> str:
    """Return the name of the body that a part belongs to: ``gripper`` for ``gripper/2`` and ``gripper``."""
    return part.partition("/")[0]
