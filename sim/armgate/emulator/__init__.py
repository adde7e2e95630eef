"""Emulated hardware: the emulated robot, and the clocks that make robots tick."""

from armgate.emulator.clock import Instant, Lateness, VirtualClock, WallClock
from armgate.emulator.robot import EmulatedRobot

__all__ = ["EmulatedRobot", "Instant", "Lateness", "VirtualClock", "WallClock"]
