"""One run of the RSI program, from RSI_ON to its end: what a restart forgets."""

from collections.abc import Mapping

from armgate.emulator.krc.arm import Arm
from armgate.emulator.krc.context import Context
from armgate.emulator.krc.correction import Correction
from armgate.emulator.krc.drive import Drives
from armgate.emulator.krc.ethernet import Element, Ethernet, Value
from armgate.emulator.krc.lateness import Lateness
from armgate.emulator.krc.machine import Event
from armgate.emulator.krc.profile import Profile
from armgate.emulator.krc.registers import Registers

Trouble = tuple[Event, str]
"""Why a run ends, and its text."""


class Run:
    """Registers, correction, drives and Delay of one run.

    Args:
        profile: The controller.
        context: Mode and limits.
        ethernet: The KRC's file.
        arm: The robot.
        programmed: Where the program keeps it: where it stood at the start, deg or mm.
    """

    def __init__(
        self, profile: Profile, context: Context, ethernet: Ethernet, arm: Arm, programmed: tuple[float, ...]
    ) -> None:
        self.programmed = programmed
        self.lateness = Lateness(context.timeout, profile.late_in_a_row, profile.late_share)
        self.drives = Drives(arm.axes, profile.tolerance, profile.cycle, programmed)
        self.correction = Correction(arm.names, context)
        self.registers = Registers(ethernet.received)
        self._inputs = ethernet.corrections(arm.names)

    def receive(self, values: Mapping[Element, Value] | None) -> tuple[str, ...]:
        """What a cycle brought, None for nothing; the declared names that a reply lacks."""
        missing = self.registers.take(values or {})
        return missing if values is not None else ()

    def late(self, late: bool) -> Trouble | None:
        """Count the cycle."""
        text = self.lateness.note(late)
        return None if text is None else (Event.TIMEOUT, f"KSS29002 RSI: {text}; the program stops")

    def move(self) -> Trouble | None:
        """Hand the corrected setpoint to the drives."""
        if self.registers.named("Stop") is True:
            return Event.SENSOR_STOP, "stopped by the sensor (Stop)"
        text = self.correction.take([self.registers.number(element) for element in self._inputs])
        if text is not None:
            return Event.MONITOR, f"KSS29000 RSI: {text}; RSI stops"
        offset = self.correction.offset
        text = self.drives.take([p + o for p, o in zip(self.programmed, offset, strict=True)])
        return None if text is None else (Event.DRIVE, text)
