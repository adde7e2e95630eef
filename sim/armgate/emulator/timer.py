"""Kernel timer with a file descriptor (Linux timerfd on CLOCK_MONOTONIC).

asyncio rounds its own timers up to a millisecond; a timerfd wakes the loop about 0.1 ms after its deadline.
Python's ``os`` has timerfd only from version 3.13 on, so ctypes is used.
"""

import ctypes
import os

_CLOCK_MONOTONIC = 1
_TFD_TIMER_ABSTIME = 1
_NS = 1_000_000_000

_libc = ctypes.CDLL(None, use_errno=True)


class _Timespec(ctypes.Structure):
    _fields_ = (("sec", ctypes.c_long), ("nsec", ctypes.c_long))


class _Itimerspec(ctypes.Structure):
    _fields_ = (("interval", _Timespec), ("value", _Timespec))


def _checked(result: int) -> int:
    if result < 0:
        number = ctypes.get_errno()
        raise OSError(number, f"timerfd: {os.strerror(number)}")
    return result


class Timer:
    """One-shot timer with an absolute deadline, after which its descriptor is readable.

    Raises:
        OSError: The kernel refuses a timer.
    """

    def __init__(self) -> None:
        self._fd = _checked(_libc.timerfd_create(_CLOCK_MONOTONIC, os.O_NONBLOCK | os.O_CLOEXEC))

    def fileno(self) -> int:
        """Return the descriptor, for an event loop."""
        return self._fd

    def arm(self, deadline_ns: int) -> None:
        """Set the deadline, ns of the monotonic clock; the timer expires at once if it has passed."""
        # An all-zero value would disarm the timer: the earliest deadline is 1 ns.
        sec, nsec = divmod(max(deadline_ns, 1), _NS)
        spec = _Itimerspec(_Timespec(0, 0), _Timespec(sec, nsec))
        _checked(_libc.timerfd_settime(self._fd, _TFD_TIMER_ABSTIME, ctypes.byref(spec), None))

    def expired(self) -> bool:
        """Return True if the deadline has passed since the timer was armed or this was last called."""
        try:
            os.read(self._fd, 8)
        except BlockingIOError:
            return False
        return True

    def close(self) -> None:
        """Close the descriptor."""
        os.close(self._fd)
