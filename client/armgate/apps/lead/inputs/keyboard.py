"""The keyboard, in a terminal: a key moves the robot as long as it repeats.

    1 … 9, 0    choose a joint (the 10th by 0)        ↑ ↓ or + -   move it
    w s, a d, r f    the tool along x, y, z           i k, j l, u o    turn it about y, z, x
    m           joints or tool                        ] [          faster, slower
    space       rest at once                          q            end

A terminal tells presses, never releases; while a key is held it repeats. So one press moves for a state
only, and a key let go, a terminal that hangs, a line that is cut all come to the same: the robot rests.
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
"""For how long one press moves, s: keyboards repeat about 30 times a second."""
_ARROWS = {b"\x1b[A": "+", b"\x1b[B": "-", b"\x1bOA": "+", b"\x1bOB": "-"}
_TOOL = {
    "w": (0, 1), "s": (0, -1), "a": (1, 1), "d": (1, -1), "r": (2, 1), "f": (2, -1),
    "u": (3, 1), "o": (3, -1), "i": (4, 1), "k": (4, -1), "j": (5, 1), "l": (5, -1),
}  # fmt: skip


def make(setting: Setting) -> "Terminal":
    """The terminal that the command runs in.

    Raises:
        UsageError: There is none.
    """
    if not sys.stdin.isatty():
        raise UsageError("the keyboard needs a terminal, and stdin is none; take another input")
    return Terminal(sys.stdin.fileno(), Keys(setting))


class Keys:
    """Wishes of keys that are pressed; knows no terminal.

    Args:
        setting: What is driven.
        now: A clock that does not go back, s.
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
        self._report(f"keyboard: {self._what()}; m: joints or tool, [ ]: speed, space: rest, q: end")

    def press(self, key: str) -> None:
        """One key came in."""
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
            self._pressed = ("", self._now())  # whatever else is pressed, the robot rests

    def request(self) -> MotionRequest:
        """What the keys say now."""
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
    """Keys of a terminal, which is put back as it was in the end."""

    def __init__(self, fd: int, keys: Keys) -> None:
        self._fd = fd
        self._keys = keys
        self._before = termios.tcgetattr(fd)
        tty.setcbreak(fd)  # Ctrl-C stays what it is

    def request(self, state: RobotState) -> MotionRequest:
        """What the keyboard says now."""
        try:
            while select.select([self._fd], [], [], 0.0)[0]:
                if not (data := os.read(self._fd, 64)):
                    return MotionRequest(ended="the terminal is gone", failed=True)
                for key in keys_in(data):
                    self._keys.press(key)
        except OSError:
            return MotionRequest(ended="the terminal is gone", failed=True)
        return self._keys.request()

    def close(self) -> None:
        """Put the terminal back, if it is still there."""
        with contextlib.suppress(termios.error):
            termios.tcsetattr(self._fd, termios.TCSADRAIN, self._before)


def keys_in(data: bytes) -> Iterator[str]:
    """The keys in what a terminal sent; sequences of keys that mean nothing here are one unknown key each."""
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
