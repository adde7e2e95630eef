"""Interruption by Ctrl-C or SIGTERM: a program that moves a robot slows it to rest before it ends."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager


class Interrupt:
    """Flag set when this process was asked to end.

    Attributes:
        asked: True once SIGINT or SIGTERM arrived.
    """

    ever = False
    """True once any interruption of this process was asked for."""

    def __init__(self) -> None:
        self.asked = False

    def ask(self) -> None:
        """Set the flag, for this instance and for the process."""
        self.asked = Interrupt.ever = True


@contextmanager
def interrupt() -> Iterator[Interrupt]:
    """Set the flag at the first SIGINT or SIGTERM; a second one ends the process at once."""
    wish = Interrupt()

    def take(_signum: int, _frame: object) -> None:
        if wish.asked:
            raise KeyboardInterrupt
        wish.ask()

    before = {signum: signal.signal(signum, take) for signum in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield wish
    finally:
        for signum, handler in before.items():
            signal.signal(signum, handler)
