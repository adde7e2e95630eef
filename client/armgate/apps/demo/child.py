"""``python -m armgate.apps.demo.child PID …`` is ``armgate …`` that ends with the process PID, its parent.

The demo ends its children in order, but it cannot when it is killed itself: then the kernel sends them
SIGTERM, at which daemon, leader and follower bring their robots to rest and end.
"""

import contextlib
import ctypes
import os
import signal
import sys

from armgate.apps.cli import main

PR_SET_PDEATHSIG = 1
HURRY = -10
"""The nice value of the demo's children, where the system lets them have it."""


def end_with(parent: int) -> None:
    """Asks the kernel for SIGTERM at the parent's death; exits if that has come already."""
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0)
    if os.getppid() != parent:
        sys.exit("armgate: the process that started this one is gone")


def hurry() -> None:
    """Goes before ordinary programs: a robot's tick cannot wait until another one has had its turn."""
    with contextlib.suppress(PermissionError):
        os.setpriority(os.PRIO_PROCESS, 0, HURRY)


if __name__ == "__main__":
    end_with(int(sys.argv[1]))
    hurry()
    main(sys.argv[2:])
