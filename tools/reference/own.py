"""Entry points of armgate's own package: the pages leave out the plug-ins that are installed beside it."""

from importlib.metadata import EntryPoint, distribution


def own_entry_points(group: str) -> list[EntryPoint]:
    """Return the entry points of this group that armgate provides, sorted by name."""
    return sorted(distribution("armgate").entry_points.select(group=group))
