"""The configuration in a recording, which may come from anywhere: it may name packed files only."""

from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

from armgate.monitor.errors import MonitorError
from armgate.monitor.urdf_file import MeshUse, read_urdf
from armgate.monitor.yaml_files import Located


def check_packed(tree: Mapping[str, Any], folder: Path, packed: Collection[str]) -> None:
    """Refuse a configuration that names another file.

    Args:
        tree: The configuration.
        folder: The folder that holds the packed files, and nothing else.
        packed: Their names.

    Raises:
        MonitorError: It names a file that is not packed.
        DescriptionError: A robot description cannot be read.
    """
    for key, name in _named("", tree):
        _check(name, packed)
        if key == "urdf":
            for body in read_urdf(folder / name).bodies:
                if isinstance(body.shape, MeshUse):
                    _check(body.shape.uri, packed)


def _named(key: str, value: object) -> Iterator[tuple[str, str]]:
    """Yield each file with the key under which it stands."""
    match value:
        case Located():
            yield key, value.text
        case Mapping():
            for own, part in value.items():
                yield from _named(str(own), part)
        case list() | tuple():
            for part in value:
                yield from _named(key, part)


def _check(name: str, packed: Collection[str]) -> None:
    if name not in packed:
        raise MonitorError(
            f"the configuration in the recording names {name!r:.80}, which is not packed with it"
        )
