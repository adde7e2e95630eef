"""Interruption by Ctrl-C or SIGTERM: a controller brings its robot to rest before it ends."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager


class Interrupt:
    """Flag that is set when this process is requested to end.

    Attributes:
        requested: True after SIGINT or SIGTERM.
    """

    ever_requested = False
    """True after any interruption of this process."""

    def __init__(self) -> None:
        self.requested = False

    def request(self) -> None:
        """Set the flag, for this instance and for the process."""
        self.requested = Interrupt.ever_requested = True


@contextmanager
def catch_interrupt() -> Iterator[Interrupt]:
    """Set the flag at the first SIGINT or SIGTERM; a second one ends the process at once."""
    interrupt = Interrupt()

    def take(_signum: int, _frame: object) -> None:
        if interrupt.requested:
            raise KeyboardInterrupt
        interrupt.request()

    before = {signum: signal.signal(signum, take) for signum in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield interrupt
    finally:
        for signum, handler in before.items():
            signal.signal(signum, handler)
