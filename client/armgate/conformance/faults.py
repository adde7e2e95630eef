"""What a network may do to a stream, as it is written after ``--faults``."""

import re
from dataclasses import dataclass, fields

_UNITS = {"": 1.0, "s": 1.0, "ms": 1e-3, "b": 1.0, "k": 1024.0, "m": 1024.0**2}
_NUMBER = re.compile(r"([0-9]*\.?[0-9]+)(ms|s|b|k|m)?", re.IGNORECASE)
_COUNTS = ("slice", "cut", "reset", "silence")
_TIMES = ("latency", "jitter", "every", "stall")


class FaultError(Exception):
    """A text after ``--faults`` that is not understood."""

    exit_code = 2


@dataclass(frozen=True, slots=True)
class Faults:
    """Faults in both directions of a connection; 0: none of that kind.

    Attributes:
        latency: Delay of every byte, s.
        jitter: How much the delay varies to both sides, s; the order of bytes stays, as TCP keeps it.
        stall: The longest time for which nothing passes, s; each lasts between half of it and all of it.
        every: Mean time between two stalls, s.
        slice: Bytes in a packet at most.
        bandwidth: Bytes per second.
        cut: After so many bytes to the server the connection is closed.
        reset: After so many bytes to the server the connection is reset.
        silence: After so many bytes to the server nothing passes any more, and nobody is told.
    """

    latency: float = 0.0
    jitter: float = 0.0
    stall: float = 0.0
    every: float = 2.0
    slice: int = 0
    bandwidth: float = 0.0
    cut: int = 0
    reset: int = 0
    silence: int = 0

    @classmethod
    def parse(cls, text: str) -> "Faults":
        """The faults of a text such as ``latency=80ms,jitter=40ms,stall=400ms,every=2s``.

        Raises:
            FaultError: It is none; the text says what there is.
        """
        known = {field.name for field in fields(cls)}
        values: dict[str, float] = {}
        for part in filter(None, text.split(",")):
            name, _, number = part.strip().partition("=")
            match = _NUMBER.fullmatch(number.strip())
            if name not in known or match is None:
                names = ", ".join(field.name for field in fields(cls))
                raise FaultError(
                    f"--faults: {part!r} is none; write NAME=NUMBER with one of {names}, "
                    "times as 80ms or 0.3s, sizes as 100 or 64k"
                )
            value = float(match[1]) * _UNITS[_unit(name, match[2])]
            values[name] = int(value) if name in _COUNTS else value
        return cls(**values)  # type: ignore[arg-type]

    @property
    def delay(self) -> float:
        """By how much an answer may come later, s."""
        return 2 * (self.latency + self.jitter + self.stall)


def _unit(name: str, unit: str | None) -> str:
    short = (unit or "").lower()
    if name in _TIMES and short not in ("", "s", "ms"):
        raise FaultError(f"--faults: {name} is a time: write it as 80ms or 0.3s")
    if name not in _TIMES and short in ("s", "ms"):
        raise FaultError(f"--faults: {name} is a size in bytes: write it as 100 or 64k")
    return short
