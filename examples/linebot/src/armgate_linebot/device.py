"""Virtual robot, a process of its own: ``armgate linebot``."""

import asyncio
import signal
from pathlib import Path
from typing import Annotated

import typer

from armgate.emulator import EmulatedRobot
from armgate.events import Joints
from armgate_linebot.kind import LinebotConfig

MAX_MISSED = 50
"""Cycles without a line of the controller after which the drives are switched off."""


class Device:
    """Robot that, like a real one, switches its drives off at a setpoint that is too fast or missing.

    Args:
        q0: Position at the start, rad or m.
        period: Cycle of its clock, s.
        lag: Time constant with which it follows setpoints, s.
        speed: Top speed of each joint, per s.
    """

    def __init__(self, q0: Joints, period: float, lag: float, speed: Joints) -> None:
        self.period = period
        self._robot = EmulatedRobot(q0, period, lag)
        self._setpoint = q0
        self._largest = tuple(1.01 * limit * period for limit in speed)
        self._missed = 0
        self._fault = ""

    def fault(self, reason: str) -> None:
        """Switch the drives off."""
        self._fault = self._fault or reason

    def take(self, line: str) -> None:
        """Handle a line from the controller."""
        word, *values = line.split()
        self._missed = 0
        if word == "RESET":
            self._fault = ""
        elif word == "SET" and not self._fault:
            setpoint = tuple(map(float, values))
            steps = zip(setpoint, self._setpoint, self._largest, strict=True)
            if any(abs(new - old) > limit for new, old, limit in steps):
                self.fault("a setpoint is too far from the last one")
            else:
                self._setpoint = setpoint

    def cycle(self, connected: bool) -> str:
        """Simulate one cycle; return the line for the controller."""
        q = self._robot.step(self._setpoint)
        self._missed += connected
        if self._missed > MAX_MISSED:
            self.fault("setpoints are missing")
        if self._fault:
            self._setpoint = q
        position = " ".join(map(repr, q))
        return f"FAULT {position} {self._fault}\n" if self._fault else f"POS {position}\n"


async def serve(device: Device, host: str, port: int) -> None:
    """Serve controllers until SIGTERM or SIGINT; SIGUSR1 is the robot's stop button."""
    loop, ending = asyncio.get_running_loop(), asyncio.Event()
    writers: set[asyncio.StreamWriter] = set()

    async def controller(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writers.add(writer)
        try:
            while line := (await reader.readline()).decode():
                device.take(line)
        except (OSError, ValueError) as error:
            device.fault(str(error))
        finally:
            writers.remove(writer)
            writer.close()

    loop.add_signal_handler(signal.SIGUSR1, device.fault, "the stop button was pressed")
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, ending.set)
    async with await asyncio.start_server(controller, host, port):
        print(f"linebot: at {host}:{port}", flush=True)
        due = loop.time()
        while not ending.is_set():
            line = device.cycle(bool(writers))
            for writer in writers:
                writer.write(line.encode())
            due += device.period
            await asyncio.sleep(max(0.0, due - loop.time()))
        for writer in writers:
            writer.close()
        await asyncio.gather(*(writer.wait_closed() for writer in writers), return_exceptions=True)


def linebot(
    configs: Annotated[list[Path], typer.Argument(metavar="CONFIG", help="Files of the cell.")],
    robot: Annotated[str, typer.Option(metavar="NAME", help="Robot of the cell.")],
) -> None:
    """Simulate a robot whose link is of kind linebot."""
    from armgate.cell.cell import build_cell
    from armgate.cell.config import load_config

    found = build_cell(load_config(configs)).robot(robot)
    own = found.config.link
    if not isinstance(own, LinebotConfig):
        raise typer.BadParameter(f"{robot} has a link of kind {own.kind}; expected linebot")
    device = Device(tuple(found.start.tolist()), found.period, own.lag, tuple(found.velocity.tolist()))
    asyncio.run(serve(device, own.host, own.port))
