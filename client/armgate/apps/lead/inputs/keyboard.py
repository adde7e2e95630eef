"""Keyboard in a terminal: a key moves the robot as long as it repeats.

    1 … 9, 0        choose a joint (0 for the 10th)   ↑ ↓ or + -      move it
    w s, a d, r f   move the tool along x, y, z       i k, j l, u o   turn the tool about y, z, x
    m               joints or tool                    ] [             faster, slower
    space           come to rest at once              q               end driving

A terminal reports key presses, never releases; a held key repeats. So one press moves the robot only for a
moment, and a released key, a hung terminal and a cut connection have the same effect: the robot comes to
rest.
"""

import contextlib
import os
import select
import sys
import termios
import tty
from collections.abc import Callable, Iterator
from time import monotonic

import numpy as np

from armgate.apps.errors import UsageError
from armgate.apps.lead.inputs import Mode, Setting, SpeedShare
from armgate.apps.lead.motions import JointRate, Motion, MotionRequest, RobotState, ToolTwist

HELD = 0.15
"""Time for which one press moves the robot, s: keyboards repeat about 30 times a second."""
_ARROWS = {b"\x1b[A": "+", b"\x1b[B": "-", b"\x1bOA": "+", b"\x1bOB": "-"}
_TOOL = {
    "w": (0, 1), "s": (0, -1), "a": (1, 1), "d": (1, -1), "r": (2, 1), "f": (2, -1),
    "u": (3, 1), "o": (3, -1), "i": (4, 1), "k": (4, -1), "j": (5, 1), "l": (5, -1),
}  # fmt: skip


def make(setting: Setting) -> "Terminal":
    """Return an input for the terminal that the command runs in.

    Raises:
        UsageError: stdin is not a terminal.
    """
    if not sys.stdin.isatty():
        raise UsageError("the keyboard needs a terminal, and stdin is not a terminal; choose another input")
    return Terminal(sys.stdin.fileno(), Keys(setting))


class Keys:
    """Requested motions from key presses; independent of the terminal.

    Args:
        setting: Robot and initial mode.
        now: Monotonic clock, s.
    """

    def __init__(self, setting: Setting, now: Callable[[], float] = monotonic) -> None:
        self._now = now
        self._report = setting.report
        self._mode: Mode = setting.mode
        self._names = [joint.name for joint in setting.robot.joints]
        self._chosen = 0
        self._speed = SpeedShare(setting.report)
        self._pressed = ("", now())
        self._ended = ""
        self._report(f"keyboard: {self._what()}; m: joints or tool, [ ]: speed, space: come to rest, q: end")

    def press(self, key: str) -> None:
        """Handle a pressed key."""
        if key in ("+", "-") or key in _TOOL:
            self._pressed = (key, self._now())
        elif key.isdecimal():
            self._choose((int(key) or 10) - 1)
        elif key == "m":
            self._mode = "tool" if self._mode == "joint" else "joint"
            self._report(self._what())
        elif key in ("]", "["):
            self._speed.faster() if key == "]" else self._speed.slower()
        elif key == "q":
            self._ended = "ended by the keyboard"
        if key not in ("+", "-", *_TOOL):
            self._pressed = ("", self._now())  # any other key brings the robot to rest

    def request(self) -> MotionRequest:
        """Return the motion requested by the keys."""
        key, at = self._pressed
        if self._ended:
            return MotionRequest(ended=self._ended)
        return MotionRequest(self._motion(key) if key and self._now() - at < HELD else None)

    def _motion(self, key: str) -> Motion | None:
        if self._mode == "joint":
            if key not in ("+", "-"):
                return None
            share = np.zeros(len(self._names))
            share[self._chosen] = self._speed.share * (1.0 if key == "+" else -1.0)
            return JointRate(share)
        if key not in _TOOL:
            return None
        row, sign = _TOOL[key]
        return ToolTwist(np.eye(6)[row] * sign * self._speed.share)

    def _choose(self, joint: int) -> None:
        if joint < len(self._names):
            self._chosen = joint
            self._mode = "joint"
            self._report(self._what())

    def _what(self) -> str:
        return "moving the tool" if self._mode == "tool" else f"moving joint {self._names[self._chosen]}"


class Terminal:
    """Input of a terminal, whose settings are restored at the end."""

    def __init__(self, fd: int, keys: Keys) -> None:
        self._fd = fd
        self._keys = keys
        self._before = termios.tcgetattr(fd)
        tty.setcbreak(fd)  # Ctrl-C still interrupts

    def request(self, state: RobotState) -> MotionRequest:
        """Return the motion requested by the keyboard."""
        try:
            while select.select([self._fd], [], [], 0.0)[0]:
                if not (data := os.read(self._fd, 64)):
                    return MotionRequest(ended="the terminal was closed", failed=True)
                for key in keys_in(data):
                    self._keys.press(key)
        except OSError:
            return MotionRequest(ended="the terminal was closed", failed=True)
        return self._keys.request()

    def close(self) -> None:
        """Restore the terminal if it still exists."""
        with contextlib.suppress(termios.error):
            termios.tcsetattr(self._fd, termios.TCSADRAIN, self._before)


def keys_in(data: bytes) -> Iterator[str]:
    """Yield the keys in a terminal's input; each unknown escape sequence is one unknown key."""
    while data:
        arrow = next((known for known in _ARROWS if data.startswith(known)), None)
        if arrow is not None:
            yield _ARROWS[arrow]
            data = data[len(arrow) :]
        elif data[:1] == b"\x1b":
            yield "unknown"
            return
        else:
            yield chr(data[0]) if data[0] < 128 else "unknown"
            data = data[1:]
