"""``python -m armgate.apps.demo.child PID …`` is ``armgate …`` that ends with the process PID, its parent.

The demo ends its children in order, but it cannot when it is killed itself: then the kernel sends them
SIGTERM, at which daemon, leader and follower bring their robots to rest and end.
"""

import ctypes
import os
import signal
import sys

from armgate.apps.cli import main

PR_SET_PDEATHSIG = 1


def end_with(parent: int) -> None:
    """Asks the kernel for SIGTERM at the parent's death; exits if that has come already."""
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0)
    if os.getppid() != parent:
        sys.exit("armgate: the process that started this one is gone")


if __name__ == "__main__":
    end_with(int(sys.argv[1]))
    main(sys.argv[2:])
