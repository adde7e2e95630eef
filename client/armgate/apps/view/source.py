"""Interface of the sources of states: a running daemon, or a recording."""

from typing import Protocol

from armgate.client import Description, State


class Source(Protocol):
    """Source of the states of one cell.

    Attributes:
        description: Description of the cell.
    """

    description: Description

    def asset(self, name: str) -> bytes:
        """Return the asset with this SHA-256, as named in the description."""
        ...

    def newest(self) -> State | None:
        """Return the state to show now; None before the first."""
        ...

    @property
    def problem(self) -> str | None:
        """Reason why no more states arrive, in words; None while they do."""
        ...

    def describe(self, state: State) -> str:
        """Return the origin and time of this state in words."""
        ...
