"""One run of the RSI program, from RSI_ON to its end: the state that a restart resets."""

from collections.abc import Mapping

from armgate.emulator.krc.context import Context
from armgate.emulator.krc.profile import Profile
from armgate.emulator.krc.robot.arm import Arm
from armgate.emulator.krc.robot.correction import Correction
from armgate.emulator.krc.robot.drives import Drives
from armgate.emulator.krc.rsi.delay import DelayCounter
from armgate.emulator.krc.rsi.ethernet import Element, Ethernet, Value
from armgate.emulator.krc.rsi.received_values import ReceivedValues
from armgate.emulator.krc.states import Event

EndOfRun = tuple[Event, str]
"""Event that ends a run, and its message."""


class RsiRun:
    """Received values, correction, drives and Delay of one run.

    Args:
        profile: Profile of the controller.
        context: Mode and limits.
        ethernet: Content of the KRC's file.
        arm: The robot.
        programmed: Programmed position: the position of the robot at the start, deg or mm.
    """

    def __init__(
        self, profile: Profile, context: Context, ethernet: Ethernet, arm: Arm, programmed: tuple[float, ...]
    ) -> None:
        self.programmed = programmed
        self.delay = DelayCounter(context.timeout, profile.late_in_a_row, profile.late_share)
        self.drives = Drives(arm.axes, profile.tolerance, profile.cycle, programmed)
        self.correction = Correction(arm.names, context)
        self.received = ReceivedValues(ethernet.received)
        self._inputs = ethernet.corrections(arm.names)

    def receive(self, values: Mapping[Element, Value] | None) -> tuple[str, ...]:
        """Store the values of a reply, None if there was none; return the declared names that it lacks."""
        missing = self.received.update(values or {})
        return missing if values is not None else ()

    def count_cycle(self, late: bool) -> EndOfRun | None:
        """Count a cycle; return the end of the run if too many were late."""
        text = self.delay.add(late)
        return None if text is None else (Event.TIMEOUT, f"KSS29002 RSI: {text}; the program stops")

    def move(self) -> EndOfRun | None:
        """Move the drives to the corrected setpoint; return the end of the run if it ends here."""
        if self.received.named("Stop") is True:
            return Event.SENSOR_STOP, "stopped by the sensor (Stop)"
        text = self.correction.apply([self.received.number(element) for element in self._inputs])
        if text is not None:
            return Event.MONITOR, f"KSS29000 RSI: {text}; RSI stops"
        offset = self.correction.offset
        text = self.drives.move([p + o for p, o in zip(self.programmed, offset, strict=True)])
        return None if text is None else (Event.DRIVE, text)
