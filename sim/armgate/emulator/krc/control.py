"""What whoever stands beside a virtual KRC can do to it: one line a command, one JSON object an answer.

The pendant: ``start stop pause resume estop reset restart``, ``jog AXIS BY`` (deg or mm), ``ipoc N``,
``status``. The network, in the direction ``to-pc`` or ``to-krc``, or both where none is named: ``drop N``,
``loss P``, ``duplicate P``, ``reorder P``, ``delay MS``, ``jitter MS``, ``cable out``, ``cable in``.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from armgate.emulator.krc.controller import PENDANT, Controller
from armgate.emulator.krc.machine import Event
from armgate.emulator.krc.network import Channel
from armgate.emulator.krc.station import Station

_MS = 1e-3
_SCALES = {"loss": 1.0, "duplicate": 1.0, "reorder": 1.0, "delay": _MS, "jitter": _MS}
_WORDS = (*PENDANT, "status", "jog", "ipoc", "drop", *_SCALES, "cable")


class ControlError(Exception):
    """A command that has no effect; says why."""


class Control:
    """Obeys commands.

    Args:
        controller: The KRC.
        channels: The network, by direction.
        station: Where it runs.
    """

    def __init__(
        self, controller: Controller, channels: Mapping[str, Channel[Any]], station: Station
    ) -> None:
        self._controller, self._channels, self._station = controller, channels, station
        self._verbs: dict[str, Callable[[list[str]], None]] = {
            "status": self._status,
            "jog": self._jog,
            "ipoc": self._ipoc,
            "drop": self._drop,
            "cable": self._cable,
        }

    def answer(self, line: str) -> str:
        """Obey a line; ``{"ok": true, …}`` with the status, or ``{"ok": false, "error": …}``."""
        try:
            self._obey(line.split())
        except ControlError as why:
            return json.dumps({"ok": False, "error": str(why)})
        return json.dumps({"ok": True, **self._full_status()})

    def _obey(self, words: list[str]) -> None:
        verb, *rest = words or [""]
        if verb in PENDANT:
            self._pendant(Event(verb), rest)
        elif verb in _SCALES:
            self._disturb(verb, rest)
        elif verb in self._verbs:
            self._verbs[verb](rest)
        else:
            raise ControlError(f"there is no command {verb[:40]!r}; expected one of {', '.join(_WORDS)}")

    def _full_status(self) -> dict[str, object]:
        network = {name: channel.counts for name, channel in self._channels.items()}
        station = {"port": self._station.port, "slips": self._station.slips, "unsent": self._station.unsent}
        return {**self._controller.status(), **station, "network": network}

    # --- the pendant --------------------------------------------------------------------------------------

    def _pendant(self, event: Event, rest: list[str]) -> None:
        _expect(rest, 0, event.value)
        _refuse(self._controller.operate(event))
        if event in (Event.START, Event.RESTART):
            self._station.reopen()

    def _status(self, rest: list[str]) -> None:
        _expect(rest, 0, "status")

    def _jog(self, rest: list[str]) -> None:
        _expect(rest, 2, "jog AXIS BY")
        _refuse(self._controller.jog(rest[0], _number(rest[1], -1e6, 1e6)))

    def _ipoc(self, rest: list[str]) -> None:
        _expect(rest, 1, "ipoc N")
        self._controller.jump_ipoc(_count(rest[0]))

    # --- the network --------------------------------------------------------------------------------------

    def _drop(self, rest: list[str]) -> None:
        value, channels = self._aimed(rest, "drop N [to-pc|to-krc]")
        for channel in channels:
            channel.drop(_count(value))

    def _disturb(self, verb: str, rest: list[str]) -> None:
        value, channels = self._aimed(rest, f"{verb} VALUE [to-pc|to-krc]")
        scale = _SCALES[verb]
        number = scale * _number(value, 0.0, 1.0 if scale == 1.0 else 10_000.0)
        for channel in channels:
            channel.change(**{verb: number})

    def _cable(self, rest: list[str]) -> None:
        value, channels = self._aimed(rest, "cable out|in [to-pc|to-krc]")
        if value not in ("out", "in"):
            raise ControlError(f"cable {value!r}; expected out or in")
        for channel in channels:
            channel.change(cut=value == "out")

    def _aimed(self, rest: list[str], usage: str) -> tuple[str, Sequence[Channel[Any]]]:
        """The value, and the channels that are meant."""
        if len(rest) == 1:
            return rest[0], list(self._channels.values())
        if len(rest) == 2 and rest[1] in self._channels:
            return rest[0], [self._channels[rest[1]]]
        raise ControlError(f"expected: {usage}")


def _expect(rest: list[str], count: int, usage: str) -> None:
    if len(rest) != count:
        raise ControlError(f"expected: {usage}")


def _refuse(why: str | None) -> None:
    if why is not None:
        raise ControlError(why)


def _number(text: str, lower: float, upper: float) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not lower <= value <= upper:
        raise ControlError(f"{text!r}; expected a number from {lower:g} to {upper:g}")
    return value


def _count(text: str) -> int:
    if not (text.isascii() and text.isdigit() and len(text) <= 20):
        raise ControlError(f"{text[:40]!r}; expected a whole number")
    return int(text)
