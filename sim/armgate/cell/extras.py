"""Hints how to install what a command lacks."""


def install(extra: str) -> str:
    """Return the command that installs an extra; armgate is in no package index, so a checkout is needed."""
    return f"in a checkout of armgate: pip install '.[{extra}]'"
