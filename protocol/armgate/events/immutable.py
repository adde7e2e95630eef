"""Dataclass decorator for events: immutable for type checkers, quick to make."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

T = TypeVar("T")


def _quick_event(*, frozen: bool, slots: bool) -> Callable[[type[T]], type[T]]:
    """Return a decorator like `dataclasses.dataclass`, without the checks of ``frozen`` at run time.

    These checks make construction three to five times slower, and every tick makes many events. Type
    checkers still report each assignment to a field. Events are hashable as frozen dataclasses are.
    """

    def made(cls: type[T]) -> type[T]:
        return dataclass(slots=slots, unsafe_hash=frozen and "__hash__" not in vars(cls))(cls)

    return made


if TYPE_CHECKING:
    from dataclasses import dataclass as event
else:
    event = _quick_event

__all__ = ["event"]
