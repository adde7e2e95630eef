"""Plans in few numbers: almost all shrink evenly to rest, and say so by two of them.

Such a plan has the increments u·(1 − k/m), k = 0 … n. It is kept as u, n and m if these give back every
increment to the last bit, and as all of its increments otherwise.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from armgate.events import Joints, Plan

_PLAN = TypeAdapter(Plan)
_LARGEST = 1 << 20
"""Most numbers of a plan; a robot of 8 joints needs so many to brake for nine minutes."""
_ULPS = np.arange(-4, 5)
"""How far from the quotient the m may be that was reckoned with, in units of the last place."""


def packed(plan: Plan) -> dict[str, Any]:
    """A plan as it stands in a recording."""
    found = {"robot": plan.robot, "key": plan.key, "seq": plan.seq}
    over = _shrinking(plan.increments)
    if over is None:
        return {**found, "increments": plan.increments}
    return {**found, "increment": plan.increments[0], "then": len(plan.increments) - 1, "over": over}


def unpacked(value: Mapping[str, Any]) -> Plan:
    """The plan.

    Raises:
        KeyError: Something is missing.
        ValueError: Something is of another type.
    """
    fields = dict(value)
    if "over" in fields:
        u, n, m = fields.pop("increment"), fields.pop("then"), fields.pop("over")
        if not 0 <= n * len(u) <= _LARGEST:
            raise ValueError(f"a plan of {n} increments")
        fields["increments"] = (u, *([x * (1.0 - k / m) for x in u] for k in range(1, n + 1)))
    return _PLAN.validate_python(fields)


def schema() -> dict[str, Any]:
    """JSON Schema of a packed plan."""
    whole: dict[str, Any] = _PLAN.json_schema()
    whole["required"].remove("increments")
    whole["properties"] |= {
        "increment": {"type": "array", "items": {"type": "number"}},
        "then": {"type": "integer"},
        "over": {"type": "number"},
    }
    return whole


def _shrinking(increments: tuple[Joints, ...]) -> float | None:
    """The m of increments u·(1 − k/m), None if they are no such ones."""
    n = len(increments) - 1
    if n < 1 or len({len(row) for row in increments}) > 1 or not increments[0]:
        return None
    rows = np.array(increments)
    u = rows[0]
    j = np.abs(u).argmax()
    first, last = increments[0][j], increments[-1][j]
    if not 0.0 < abs(last) < abs(first) < math.inf:
        return None
    m = n / (1.0 - last / first)
    near = m + np.spacing(m) * _ULPS
    shares = 1.0 - np.arange(1.0, n + 1.0) / near[:, None]
    # As bits: the sign of a zero counts.
    exact = ((u * shares[:, :, None]).view(np.int64) == rows[1:].view(np.int64)).all((1, 2))
    return float(near[exact.argmax()]) if exact.any() else None
