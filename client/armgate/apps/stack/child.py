"""``python -m armgate.apps.stack.child PID PRIORITY …`` is ``armgate …`` that ends with its parent PID.

PRIORITY is that of a real-time process (SCHED_RR), if the system allows it; 0 is an ordinary process.

The demo ends its children in order, but it cannot when it is killed itself: then the kernel sends them
SIGTERM, at which daemon, leader and follower bring their robots to rest and end.
"""

import contextlib
import ctypes
import os
import signal
import sys
from typing import NoReturn

from armgate.apps.cli import main
from armgate.apps.interrupt import Interrupt

INTERRUPTED = 128 + signal.SIGINT
"""Exit status of a child that ended well, but because a signal asked it to."""
PR_SET_PDEATHSIG = 1


def end_with(parent: int) -> None:
    """Asks the kernel for SIGTERM at the parent's death; exits if that has come already."""
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0)
    if os.getppid() != parent:
        sys.exit("armgate: the process that started this one is gone")


def hurry(priority: int) -> None:
    """Become a real-time process if the system allows it, unless the priority is 0.

    A robot's tick cannot wait for ordinary programs.
    """
    if priority == 0:
        return
    policy = os.SCHED_RR | os.SCHED_RESET_ON_FORK
    with contextlib.suppress(PermissionError):
        os.sched_setscheduler(0, policy, os.sched_param(priority))


def live(arguments: list[str]) -> NoReturn:
    """Run ``armgate ARGUMENTS``; exit with its status, or with INTERRUPTED instead of 0 after a signal.

    A person who presses Ctrl-C gets 0 from a robot that came to rest. A run has to know that its participant
    was stopped before its work was done.
    """
    try:
        main(arguments)
    except SystemExit as end:
        if end.code in (0, None) and Interrupt.ever_requested:
            sys.exit(INTERRUPTED)
        raise


if __name__ == "__main__":
    parent, priority, *arguments = sys.argv[1:]
    end_with(int(parent))
    hurry(int(priority))
    live(arguments)
