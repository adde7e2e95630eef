"""Registry of the kinds of link: the entry points of the group ``armgate.links``.

A kind is imported only when a configuration names it. Packages outside of this
repository register kinds in the same way; docs/adding-a-link.md shows one.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from pydantic import ValidationError
from pydantic_core import InitErrorDetails, PydanticCustomError

from armgate.cell.config.link import LinkConfig

if TYPE_CHECKING:
    from armgate.cell.config import CellConfig

GROUP = "armgate.links"


class LinkKindError(ValueError):
    """Kind of link that is not installed, or cannot be used; the text names the kinds and the remedy."""

    exit_code = 2


@dataclass(frozen=True)
class VirtualRobot:
    """Process that replaces a real robot.

    Attributes:
        name: Name of the process and of its log.
        command: Words of its command line, after ``armgate``.
    """

    name: str
    command: Sequence[str]


class ConfiguredKind(Protocol):
    """Interface of a kind for code that makes no links; `armgate.links.kind.LinkKind` implements it."""

    config: type[Any]
    """Model of the ``link`` section."""
    self_clocked: bool
    """True if the robot has a clock of its own: then the robot server holds it."""

    def virtual(
        self, own: Any, config: "CellConfig", robot: str, files: Sequence[Path], logs: Path
    ) -> VirtualRobot | None:
        """Return the process that replaces the robot, None if there is none."""


@cache
def _registered() -> Mapping[str, Sequence[EntryPoint]]:
    found: dict[str, list[EntryPoint]] = {}
    for entry in entry_points(group=GROUP):
        found.setdefault(entry.name, []).append(entry)
    return found


def installed_kinds() -> list[str]:
    """Return the names of all kinds that are installed, in alphabetical order."""
    return sorted(_registered())


@cache
def load_kind(name: str) -> ConfiguredKind:
    """Import a kind of link and return its object.

    Raises:
        LinkKindError: It is not installed, or comes from two packages, or cannot be imported, or is not a
            `LinkKind`.
    """
    entries = _registered().get(name, ())
    if not entries:
        known = ", ".join(installed_kinds())
        raise LinkKindError(
            f"kind {name[:60]!r} is not installed; expected one of {known}, or install the package that "
            "provides this kind"
        )
    if len(entries) > 1:
        packages = ", ".join(sorted(map(_package, entries)))
        raise LinkKindError(
            f"kind {name!r} comes from {len(entries)} packages ({packages}); uninstall all but one of them"
        )
    (entry,) = entries
    try:
        kind: ConfiguredKind = entry.load()
    except Exception as error:  # another project's package may raise anything
        text = f"{type(error).__name__}: {error}"
        raise _broken(entry, f"cannot be imported ({text})") from error
    model = getattr(kind, "config", None)
    if not (isinstance(model, type) and issubclass(model, LinkConfig) and hasattr(kind, "virtual")):
        raise _broken(entry, "is not a LinkKind")
    return kind


def read_link(given: object) -> object:
    """Read the ``link`` section of a robot by the model of its kind.

    Returns:
        The configuration; a value that is not a mapping is returned unchanged, and pydantic rejects it.

    Raises:
        ValidationError: The kind is missing, or cannot be used, or the section does not fit its model.
    """
    if not isinstance(given, dict):
        return given
    if "kind" not in given:
        raise _invalid("missing_kind", ValueError("the key 'kind' is missing; expected it here"), (), given)
    try:
        kind = load_kind(str(given["kind"]))
    except LinkKindError as error:
        raise _invalid("link_kind", error, ("kind",), given["kind"]) from error
    return kind.config.model_validate(given)


def _invalid(title: str, error: ValueError, path: tuple[str, ...], given: object) -> ValidationError:
    text = PydanticCustomError("value_error", "{error}", {"error": error})
    return ValidationError.from_exception_data(title, [InitErrorDetails(type=text, loc=path, input=given)])


def _package(entry: EntryPoint) -> str:
    return entry.value if entry.dist is None else entry.dist.name


def _broken(entry: EntryPoint, text: str) -> LinkKindError:
    return LinkKindError(
        f"kind {entry.name!r}: {entry.value} of the package {_package(entry)} {text}; repair or uninstall it"
    )
