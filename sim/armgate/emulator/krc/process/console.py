"""Console of a virtual KRC: each line on stdin is a command, and its answer is one JSON object.

Pendant: ``start stop pause resume estop reset restart``, ``jog AXIS BY`` (deg or mm), ``ipoc N``, ``status``.
Network, in the direction ``to-pc`` or ``to-krc``, or by default in both: ``drop N``, ``loss P``,
``duplicate P``, ``reorder P``, ``delay MS``, ``jitter MS``, ``cable out``, ``cable in``.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from armgate.emulator.krc.controller import PENDANT, Controller
from armgate.emulator.krc.errors import ConsoleError
from armgate.emulator.krc.process.network import Channel
from armgate.emulator.krc.process.real_time import RealTimeRunner
from armgate.emulator.krc.states import Event

_MS = 1e-3
_SCALES = {"loss": 1.0, "duplicate": 1.0, "reorder": 1.0, "delay": _MS, "jitter": _MS}
_COMMANDS = (*PENDANT, "status", "jog", "ipoc", "drop", *_SCALES, "cable")


class Console:
    """Executor of commands.

    Args:
        controller: The KRC.
        channels: The simulated network, by direction.
        runner: Runner of the controller.
    """

    def __init__(
        self, controller: Controller, channels: Mapping[str, Channel[Any]], runner: RealTimeRunner
    ) -> None:
        self._controller, self._channels, self._runner = controller, channels, runner
        self._commands: dict[str, Callable[[list[str]], None]] = {
            "status": self._status,
            "jog": self._jog,
            "ipoc": self._ipoc,
            "drop": self._drop,
            "cable": self._cable,
        }

    def answer(self, line: str) -> str:
        """Execute a line; return ``{"ok": true, …}`` with the status, or ``{"ok": false, "error": …}``."""
        try:
            self._execute(line.split())
        except ConsoleError as error:
            return json.dumps({"ok": False, "error": str(error)})
        return json.dumps({"ok": True, **self._full_status()})

    def _execute(self, words: list[str]) -> None:
        command, *arguments = words or [""]
        if command in PENDANT:
            self._pendant(Event(command), arguments)
        elif command in _SCALES:
            self._disturb(command, arguments)
        elif command in self._commands:
            self._commands[command](arguments)
        else:
            raise ConsoleError(
                f"there is no command {command[:40]!r}; expected one of {', '.join(_COMMANDS)}"
            )

    def _full_status(self) -> dict[str, object]:
        network = {name: channel.counts for name, channel in self._channels.items()}
        runner = {"port": self._runner.port, "slips": self._runner.slips, "unsent": self._runner.unsent}
        return {**self._controller.status(), **runner, "network": network}

    # --- pendant ------------------------------------------------------------------------------------------

    def _pendant(self, event: Event, arguments: list[str]) -> None:
        _expect(arguments, 0, event.value)
        _raise_if(self._controller.operate(event))
        if event in (Event.START, Event.RESTART):
            self._runner.reopen()

    def _status(self, arguments: list[str]) -> None:
        _expect(arguments, 0, "status")

    def _jog(self, arguments: list[str]) -> None:
        _expect(arguments, 2, "jog AXIS BY")
        _raise_if(self._controller.jog(arguments[0], _number(arguments[1], -1e6, 1e6)))

    def _ipoc(self, arguments: list[str]) -> None:
        _expect(arguments, 1, "ipoc N")
        self._controller.jump_ipoc(_count(arguments[0]))

    # --- network ------------------------------------------------------------------------------------------

    def _drop(self, arguments: list[str]) -> None:
        value, channels = self._directed(arguments, "drop N [to-pc|to-krc]")
        for channel in channels:
            channel.drop(_count(value))

    def _disturb(self, command: str, arguments: list[str]) -> None:
        value, channels = self._directed(arguments, f"{command} VALUE [to-pc|to-krc]")
        scale = _SCALES[command]
        number = scale * _number(value, 0.0, 1.0 if scale == 1.0 else 10_000.0)
        for channel in channels:
            channel.change(**{command: number})

    def _cable(self, arguments: list[str]) -> None:
        value, channels = self._directed(arguments, "cable out|in [to-pc|to-krc]")
        if value not in ("out", "in"):
            raise ConsoleError(f"cable {value!r}; expected out or in")
        for channel in channels:
            channel.change(cut=value == "out")

    def _directed(self, arguments: list[str], usage: str) -> tuple[str, Sequence[Channel[Any]]]:
        """Return the value, and the channels of the given direction, or of both."""
        if len(arguments) == 1:
            return arguments[0], list(self._channels.values())
        if len(arguments) == 2 and arguments[1] in self._channels:
            return arguments[0], [self._channels[arguments[1]]]
        raise ConsoleError(f"expected: {usage}")


def _expect(arguments: list[str], count: int, usage: str) -> None:
    if len(arguments) != count:
        raise ConsoleError(f"expected: {usage}")


def _raise_if(reason: str | None) -> None:
    if reason is not None:
        raise ConsoleError(reason)


def _number(text: str, lower: float, upper: float) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not lower <= value <= upper:
        raise ConsoleError(f"{text!r}; expected a number from {lower:g} to {upper:g}")
    return value


def _count(text: str) -> int:
    if not (text.isascii() and text.isdigit() and len(text) <= 20):
        raise ConsoleError(f"{text[:40]!r}; expected a whole number")
    return int(text)
