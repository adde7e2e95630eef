"""``python -m armgate.apps.stack.child PID PRIORITY …`` runs ``armgate …`` as a child process.

The process also ends when its parent PID ends.

PRIORITY is the real-time priority (SCHED_RR), if the system allows it; 0 means an ordinary process.

The demo ends its children in order. If the demo itself is killed, the kernel sends SIGTERM to its children,
and daemon, leader and follower bring their robots to rest and end.
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
"""Exit status of a child that ended without an error because of a signal."""
PR_SET_PDEATHSIG = 1


def end_with(parent: int) -> None:
    """Request SIGTERM from the kernel at the parent's death; exit if the parent has already died."""
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0)
    if os.getppid() != parent:
        sys.exit("armgate: the parent process has ended")


def set_priority(priority: int) -> None:
    """Make this process real-time if the system allows it; priority 0 changes nothing.

    The tick of a robot must not wait for ordinary programs.
    """
    if priority == 0:
        return
    policy = os.SCHED_RR | os.SCHED_RESET_ON_FORK
    with contextlib.suppress(PermissionError):
        os.sched_setscheduler(0, policy, os.sched_param(priority))


def run_command(arguments: list[str]) -> NoReturn:
    """Run ``armgate ARGUMENTS``; exit with its status, or with INTERRUPTED instead of 0 after a signal.

    After Ctrl-C a command exits with 0 once its robot has come to rest. With INTERRUPTED, a run can
    distinguish this from a participant that has finished.
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
    set_priority(int(priority))
    run_command(arguments)
