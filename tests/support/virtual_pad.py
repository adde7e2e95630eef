"""``armgate`` with a virtual gamepad of SDL in its process, moved by lines on stdin.

``axis NAME VALUE`` (−1 to 1), ``button NAME 0|1``, ``pull`` (the pad is unplugged).
"""

import ctypes
import sys
import threading
from pathlib import Path

import pygame
from pygame._sdl2 import controller

from armgate.apps.cli import main

_GAMECONTROLLER = 1
AXES = ("LEFTX", "LEFTY", "RIGHTX", "RIGHTY", "TRIGGERLEFT", "TRIGGERRIGHT")
BUTTONS = (
    "A", "B", "X", "Y", "BACK", "GUIDE", "START", "LEFTSTICK", "RIGHTSTICK", "LEFTSHOULDER",
    "RIGHTSHOULDER", "DPAD_UP", "DPAD_DOWN", "DPAD_LEFT", "DPAD_RIGHT",
)  # fmt: skip


class Pad:
    """Virtual gamepad, made with the SDL library in pygame's wheel."""

    def __init__(self) -> None:
        (file,) = (Path(pygame.__file__).parents[1] / "pygame_ce.libs").glob("libSDL2-2*")
        self.sdl = ctypes.CDLL(str(file))
        self.sdl.SDL_JoystickOpen.restype = ctypes.c_void_p
        pygame.display.init()
        controller.init()
        self.device = self.sdl.SDL_JoystickAttachVirtual(_GAMECONTROLLER, len(AXES), len(BUTTONS), 0)
        assert self.device >= 0
        self.pad = ctypes.c_void_p(self.sdl.SDL_JoystickOpen(self.device))
        for name in ("TRIGGERLEFT", "TRIGGERRIGHT"):
            self.axis(name, -1.0)

    def axis(self, name, value):
        self.sdl.SDL_JoystickSetVirtualAxis(self.pad, AXES.index(name), ctypes.c_int16(round(value * 32767)))

    def button(self, name, value):
        self.sdl.SDL_JoystickSetVirtualButton(self.pad, BUTTONS.index(name), ctypes.c_uint8(int(value)))

    def pull(self):
        self.sdl.SDL_JoystickDetachVirtual(self.device)

    def obey(self):
        # Unbuffered: a thread that waits inside of sys.stdin can keep Python from ending.
        for line in open(0, "rb", buffering=0, closefd=False):  # noqa: SIM115
            what, *more = line.decode().split()
            getattr(self, what)(*(float(word) if not word[0].isalpha() else word for word in more))


if __name__ == "__main__":
    if sys.argv[1] != "none":
        threading.Thread(target=Pad().obey, daemon=True).start()
    main(sys.argv[2:])
