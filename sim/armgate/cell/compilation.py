"""Compilation of kernels by numba, which is optional (extra `fast`).

A kernel is compiled when it is first needed, and stored in numba's cache. So only the first use after an
installation takes long; `announced` lets a command say so. numba itself is imported only by the functions
here and by modules of kernels, because that takes a second.
"""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any, TypeVar, cast

F = TypeVar("F", bound=Callable[..., Any])

NOTICE = "compiling kernels, once after installation (about 30 s)"


def available() -> bool:
    """Return True if numba is installed."""
    try:
        import_module("numba")
    except ImportError:
        return False
    return True


def kernel(function: F) -> F:
    """Return the function, compiled at its first call, with numba's cache if one can be written.

    numba caches in the folder of the function's file, else in the user's cache folder. If neither can be
    written (a read-only installation without a home folder), each process compiles for itself.
    """
    numba = import_module("numba")
    try:
        return cast("F", numba.njit(cache=True, error_model="numpy")(function))
    except RuntimeError:
        return cast("F", numba.njit(error_model="numpy")(function))


def print_notice(notice: str) -> None:
    """Print a notice of a command to stderr."""
    sys.stderr.write(f"armgate: {notice}\n")
    sys.stderr.flush()


@contextmanager
def announced(announce: Callable[[str], object] = print_notice) -> Iterator[None]:
    """Call ``announce`` with `NOTICE` when a kernel is compiled in the context; loading one is no reason."""
    if not available():
        yield
        return
    event: Any = import_module("numba.core.event")

    class FirstCompilation(event.Listener):  # type: ignore[misc]
        """Listener to the first compilation."""

        announced = False

        def on_start(self, event: object) -> None:
            """Announce the first compilation."""
            if not self.announced:
                self.announced = True
                announce(NOTICE)

        def on_end(self, event: object) -> None:
            """Do nothing."""

    with event.install_listener("numba:compile", FirstCompilation()):
        yield
