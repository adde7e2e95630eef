"""Readable log of the bytes sent and received in one case: times, bytes, meaning."""

import asyncio
from dataclasses import dataclass
from typing import Any

_KEPT = 600
_SHOWN = 96
_TEXT = 400


@dataclass(frozen=True, slots=True)
class Record:
    """One entry of the log.

    Attributes:
        time: Time since the case began, s.
        connection: Name of the connection.
        direction: ``→`` to the server, ``←`` from it, ``·`` for an event of the connection itself.
        data: The bytes, empty for events.
        text: Their meaning.
    """

    time: float
    connection: str
    direction: str
    data: bytes
    text: str

    def line(self) -> str:
        """Return one line: time, connection, direction, meaning, hex."""
        hexed = self.data[:_SHOWN].hex(" ", -4) + (
            f" … {len(self.data)} bytes" if len(self.data) > _SHOWN else ""
        )
        return f"{self.time:9.4f}  {self.connection:<12} {self.direction} {self.text}" + (
            f"\n{'':27}{hexed}" if hexed else ""
        )


class WireLog:
    """The records of one case; if there are very many, the first and the last of them."""

    def __init__(self) -> None:
        self._start = asyncio.get_running_loop().time()
        self._first: list[Record] = []
        self._last: list[Record] = []
        self._dropped = 0

    def add(self, connection: str, direction: str, data: bytes, meaning: Any) -> None:
        """Add bytes and their meaning."""
        text = meaning if isinstance(meaning, str) else repr(meaning)
        shown = text if len(text) <= _TEXT else text[:_TEXT] + "…"
        now = asyncio.get_running_loop().time() - self._start
        record = Record(now, connection, direction, data[: 2 * _SHOWN], shown)
        if len(self._first) < _KEPT // 2:
            self._first.append(record)
            return
        self._last.append(record)
        if len(self._last) > _KEPT:
            self._dropped += len(self._last) - _KEPT // 2
            del self._last[: -_KEPT // 2]

    def lines(self) -> list[str]:
        """Return the lines of all kept records, oldest first."""
        between = [f"… {self._dropped} records omitted …"] if self._dropped else []
        return [r.line() for r in self._first] + between + [r.line() for r in self._last]
