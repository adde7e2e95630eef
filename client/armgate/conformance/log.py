"""What went over the wire in one case, for people: times, bytes, meaning."""

import asyncio
from dataclasses import dataclass
from typing import Any

_KEPT = 600
_SHOWN = 96
_TEXT = 400


@dataclass(frozen=True, slots=True)
class Record:
    """One thing that happened.

    Attributes:
        time: Since the case began, s.
        who: Which connection.
        way: ``→`` to the server, ``←`` from it, ``·`` about the connection itself.
        data: The bytes, none for events.
        text: What they mean.
    """

    time: float
    who: str
    way: str
    data: bytes
    text: str

    def line(self) -> str:
        """One line: time, connection, direction, meaning, hex."""
        hexed = self.data[:_SHOWN].hex(" ", -4) + (
            f" … {len(self.data)} bytes" if len(self.data) > _SHOWN else ""
        )
        return f"{self.time:9.4f}  {self.who:<12} {self.way} {self.text}" + (
            f"\n{'':27}{hexed}" if hexed else ""
        )


class WireLog:
    """The records of one case; of very many the first and the last are kept."""

    def __init__(self) -> None:
        self._start = asyncio.get_running_loop().time()
        self._first: list[Record] = []
        self._last: list[Record] = []
        self._dropped = 0

    def add(self, who: str, way: str, data: bytes, meaning: Any) -> None:
        """Note bytes and what they mean."""
        text = meaning if isinstance(meaning, str) else repr(meaning)
        shown = text if len(text) <= _TEXT else text[:_TEXT] + "…"
        record = Record(asyncio.get_running_loop().time() - self._start, who, way, data[: 2 * _SHOWN], shown)
        if len(self._first) < _KEPT // 2:
            self._first.append(record)
            return
        self._last.append(record)
        if len(self._last) > _KEPT:
            self._dropped += len(self._last) - _KEPT // 2
            del self._last[: -_KEPT // 2]

    def lines(self) -> list[str]:
        """All that is kept, oldest first."""
        between = [f"… {self._dropped} records left out …"] if self._dropped else []
        return [r.line() for r in self._first] + between + [r.line() for r in self._last]
