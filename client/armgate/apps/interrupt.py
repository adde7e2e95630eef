"""Ctrl-C as a wish: a program that moves a robot slows it to rest before it ends."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager


class Interrupt:
    """Whether somebody asked this process to end."""

    def __init__(self) -> None:
        self.asked = False


@contextmanager
def interrupt() -> Iterator[Interrupt]:
    """Turns the first SIGINT or SIGTERM into a wish; a second one ends the process at once."""
    wish = Interrupt()

    def take(_signum: int, _frame: object) -> None:
        if wish.asked:
            raise KeyboardInterrupt
        wish.asked = True

    before = {signum: signal.signal(signum, take) for signum in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield wish
    finally:
        for signum, handler in before.items():
            signal.signal(signum, handler)
