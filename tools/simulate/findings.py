"""Violations of invariants, collected while a simulation runs."""

from collections.abc import Callable


class Findings:
    """Collector of violations.

    Args:
        trace: Adds a line to the trace.

    Attributes:
        all: The violations, the first one first.
    """

    def __init__(self, trace: Callable[..., None]) -> None:
        self._trace = trace
        self.all: list[str] = []

    def report(self, invariant: str, text: str) -> None:
        """Note a violation."""
        self.all.append(f"{invariant}: {text}")
        self._trace("VIOLATION", invariant, text)

    def check(self, holds: bool, invariant: str, text: Callable[[], str]) -> None:
        """Note a violation unless a condition holds."""
        if not holds:
            self.report(invariant, text())
