"""Which names a robot, link, joint, frame or body may have: the ones that the protocol can carry."""

import re

NAME = r"^[A-Za-z0-9_.:-]{1,64}$"
"""No slash: that separates a robot's name from its body's in ``FR/link_3``."""

MAX_NAME = 64
"""Longest name of any kind, also of ``robot/body``."""

NAME_TEXT = f"1 to {MAX_NAME} letters, digits, or any of _ . : -"

_NAME = re.compile(NAME)


def is_name(text: str) -> bool:
    """Whether this may be a name."""
    return _NAME.fullmatch(text) is not None
