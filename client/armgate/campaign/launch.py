"""``python -I -S launch.py PID COMMAND …`` runs a command that the kernel kills when its parent PID ends.

A worker that exceeds the timeout or is killed cannot end its commands. Ctrl-C is ignored by processes that
start others in the background, and a command must end at SIGINT, so the default action is restored.
"""

import ctypes
import os
import signal
import sys

PR_SET_PDEATHSIG = 1


def launch(parent: int, words: list[str]) -> None:
    """Replace this process by the command; print an error and exit with 127 if it cannot be run."""
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    if os.getppid() != parent:
        sys.exit("the parent process has ended")
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    try:
        os.execvp(words[0], words)  # noqa: S606  (the user names the commands)
    except OSError as error:
        sys.stderr.write(f"{words[0]}: {error.strerror}\n")
        sys.exit(127)


if __name__ == "__main__":
    launch(int(sys.argv[1]), sys.argv[2:])
