"""How fast a hand drives, in steps."""

from collections.abc import Callable

_LEAST = 1.0 / 16.0


class Pace:
    """A share of the leader's largest speeds, halved and doubled.

    Attributes:
        share: Above 0, at most 1.

    Args:
        tell: Prints a line for people.
    """

    def __init__(self, tell: Callable[[str], object]) -> None:
        self.share = 0.5
        self._tell = tell

    def faster(self) -> None:
        """Double it, up to all."""
        self._set(min(1.0, 2.0 * self.share))

    def slower(self) -> None:
        """Halve it."""
        self._set(max(_LEAST, 0.5 * self.share))

    def _set(self, share: float) -> None:
        self.share = share
        self._tell(f"{share:.0%} of the speed")
