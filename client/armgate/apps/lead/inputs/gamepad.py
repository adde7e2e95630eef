"""Gamepad: it moves the robot only while its deadman button, the left shoulder, is held.

    left shoulder         hold to move, release to come to rest
    right stick button    joints or tool
    D-pad up, down        faster, slower
    start button          end driving

    tool:   left stick x and y, right trigger up, left trigger down;
            right stick turns about y and z, A and B about x
    joints: left stick forward and back moves the chosen joint, D-pad left and right choose another

Directions are along the world's axes: pushing the stick forward moves the tool along +x, pushing it left
moves it along +y.
"""

import os
from types import ModuleType
from typing import Any

import numpy as np

from armgate.apps.errors import AppError
from armgate.apps.lead.inputs import Mode, Setting, SpeedShare
from armgate.apps.lead.motions import JointRate, Motion, MotionRequest, RobotState, ToolTwist

DEAD_ZONE = 0.15
"""Share of the stick's range that counts as zero: released sticks do not return exactly to the middle."""
_FULL = 32767.0


def make(setting: Setting) -> "Gamepad":
    """Return an input for the first gamepad that is plugged in.

    Raises:
        AppError: No gamepad is plugged in.
        ModuleNotFoundError: pygame is not installed.
    """
    pygame, controller = _library()
    pads = [number for number in range(controller.get_count()) if controller.is_controller(number)]
    if not pads:
        pygame.quit()
        raise AppError("no gamepad is plugged in; plug one in and start again")
    return Gamepad(setting, pygame, controller.Controller(pads[0]))


def _library() -> tuple[ModuleType, ModuleType]:
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
    os.environ.setdefault("SDL_VIDEODRIVER", "dummy")  # events of the pad arrive even without a window
    os.environ.setdefault("SDL_NO_SIGNAL_HANDLERS", "1")
    os.environ.setdefault("SDL_JOYSTICK_ALLOW_BACKGROUND_EVENTS", "1")
    import pygame
    from pygame._sdl2 import controller

    pygame.display.init()
    controller.init()
    return pygame, controller


class Gamepad:
    """Input of one gamepad.

    The deadman button has no effect until it has been released once, so a button that is taped down never
    moves the robot.
    """

    def __init__(self, setting: Setting, pygame: Any, pad: Any) -> None:
        self._pygame = pygame
        self._pad = pad
        self._report = setting.report
        self._mode: Mode = setting.mode
        self._names = [joint.name for joint in setting.robot.joints]
        self._chosen = 0
        self._speed = SpeedShare(setting.report)
        self._armed = self._prompted = False

    def request(self, state: RobotState) -> MotionRequest:
        """Return the motion requested by the pad."""
        pg = self._pygame
        for event in pg.event.get():
            if event.type == pg.CONTROLLERBUTTONDOWN:
                self._pressed(event.button)
        if not self._pad.attached():
            return MotionRequest(ended="the gamepad was unplugged", failed=True)
        if self._pad.get_button(pg.CONTROLLER_BUTTON_START):
            return MotionRequest(ended="ended by the gamepad")
        held = bool(self._pad.get_button(pg.CONTROLLER_BUTTON_LEFTSHOULDER))
        if not self._armed:
            self._arm(held)
            return MotionRequest()
        return MotionRequest(self._motion() if held else None)

    def _arm(self, held: bool) -> None:
        if not held:
            self._armed = True
            self._report(f"gamepad {self._pad.name}: hold the left shoulder to move, {self._what()}")
        elif not self._prompted:
            self._prompted = True
            self._report("release the left shoulder first")

    def close(self) -> None:
        """Close the pad."""
        self._pygame.quit()

    # --- sticks and triggers ------------------------------------------------------------------------------

    def _motion(self) -> Motion:
        return JointRate(self._joints()) if self._mode == "joint" else ToolTwist(self._twist())

    def _joints(self) -> np.ndarray:
        share = np.zeros(len(self._names))
        share[self._chosen] = -self._axis("LEFTY") * self._speed.share
        return share

    def _twist(self) -> np.ndarray:
        linear = (
            -self._axis("LEFTY"),
            -self._axis("LEFTX"),
            self._axis("TRIGGERRIGHT") - self._axis("TRIGGERLEFT"),
        )
        roll = self._button("A") - self._button("B")
        angular = (roll, -self._axis("RIGHTY"), -self._axis("RIGHTX"))
        return np.array([*linear, *angular]) * self._speed.share

    def _axis(self, name: str) -> float:
        """Return the value of a stick or trigger, −1 to 1, without its dead zone."""
        value = self._pad.get_axis(getattr(self._pygame, f"CONTROLLER_AXIS_{name}")) / _FULL
        return beyond(value)

    def _button(self, name: str) -> float:
        return float(self._pad.get_button(getattr(self._pygame, f"CONTROLLER_BUTTON_{name}")))

    # --- buttons --------------------------------------------------------------------------------------------

    def _pressed(self, button: int) -> None:
        pg = self._pygame
        match button:
            case pg.CONTROLLER_BUTTON_RIGHTSTICK:
                self._mode = "tool" if self._mode == "joint" else "joint"
                self._report(self._what())
            case pg.CONTROLLER_BUTTON_DPAD_LEFT | pg.CONTROLLER_BUTTON_DPAD_RIGHT:
                by = 1 if button == pg.CONTROLLER_BUTTON_DPAD_RIGHT else -1
                self._chosen = (self._chosen + by) % len(self._names)
                self._report(self._what())
            case pg.CONTROLLER_BUTTON_DPAD_UP:
                self._speed.faster()
            case pg.CONTROLLER_BUTTON_DPAD_DOWN:
                self._speed.slower()

    def _what(self) -> str:
        return "moving the tool" if self._mode == "tool" else f"moving joint {self._names[self._chosen]}"


def beyond(value: float) -> float:
    """Return a stick's value without its dead zone: 0 inside it, rising linearly to ±1 outside."""
    rest = max(0.0, abs(value) - DEAD_ZONE) / (1.0 - DEAD_ZONE)
    return float(np.copysign(min(rest, 1.0), value))
