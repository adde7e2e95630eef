"""Comparison of recorded and recomputed outputs of the gate, bit for bit or within a tolerance."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import fields, is_dataclass
from struct import pack
from typing import Any

from armgate.events import GateOutput, Stopped

TOLERANCE = 1e-6
"""Tolerance for numbers that another kind of machine computed, rad or m."""


def differences(
    recorded: Sequence[GateOutput], again: Sequence[GateOutput], tolerance: float | None = None
) -> list[str]:
    """Return the differences, such as ``verdict.beta: 0.5, was 0.75``; empty if there are none.

    Args:
        recorded: Recorded outputs of the gate.
        again: Recomputed outputs.
        tolerance: Largest difference of equal numbers; None: they must be identical.
    """
    if len(recorded) != len(again):
        return [f"{_kinds(again)}, was {_kinds(recorded)}"]
    return [
        text
        for a, b in zip(recorded, again, strict=True)
        for text in _differences(type(b).__name__.lower(), a, b, tolerance)
    ]


def _kinds(outputs: Sequence[GateOutput]) -> str:
    return " and ".join(type(output).__name__.lower() for output in outputs) or "nothing"


def _differences(where: str, a: Any, b: Any, tolerance: float | None) -> Iterator[str]:
    if isinstance(a, float) and isinstance(b, float):
        if not _equal(a, b, tolerance):
            yield f"{where}: {b!r}, was {a!r}"
    elif type(a) is not type(b):
        yield f"{where}: {b!r}, was {a!r}"
    elif is_dataclass(a) and not isinstance(a, type):
        for field in fields(a):
            # With a tolerance, words and rounded numbers of a text may differ; the numbers are compared.
            if tolerance is None or not _is_text(a, field.name):
                yield from _differences(
                    f"{where}.{field.name}", getattr(a, field.name), getattr(b, field.name), tolerance
                )
    elif isinstance(a, tuple):
        if len(a) != len(b):
            yield f"{where}: {len(b)} items, were {len(a)}"
            return
        for number, (x, y) in enumerate(zip(a, b, strict=True)):
            yield from _differences(f"{where}[{number}]", x, y, tolerance)
    elif a != b:
        yield f"{where}: {b!r}, was {a!r}"


def _is_text(output: object, field: str) -> bool:
    return field == "text" or (isinstance(output, Stopped) and field == "reason")


def _equal(a: float, b: float, tolerance: float | None) -> bool:
    if tolerance is None or not (math.isfinite(a) and math.isfinite(b)):
        return pack("<d", a) == pack("<d", b)
    return abs(a - b) <= tolerance
