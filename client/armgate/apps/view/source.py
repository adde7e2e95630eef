"""Where what is shown comes from: a running daemon, or a recording of one."""

from typing import Protocol

from armgate.client import Description, State


class Source(Protocol):
    """States of one cell, and what it consists of.

    Attributes:
        description: The cell.
    """

    description: Description

    def asset(self, name: str) -> bytes:
        """The asset of this SHA-256, as the description names it."""
        ...

    def newest(self) -> State | None:
        """The state to show now; None before the first."""
        ...

    @property
    def problem(self) -> str | None:
        """Why no more states come, in words; None while they do."""
        ...

    def describe(self, state: State) -> str:
        """Where this state comes from and of what time it is, in words."""
        ...
