"""Compact encoding of plans: almost all plans brake linearly to rest.

Such a plan has the increments u·(1 − k/m), k = 0 … n. It is stored as u, n and m if these reproduce every
increment to the last bit; otherwise all increments are stored.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from armgate.events import Joints, Plan

_PLAN = TypeAdapter(Plan)
_LARGEST = 1 << 20
"""Largest plan, in numbers: nine minutes of braking for a robot with 8 joints."""
_ULPS = np.arange(-4, 5)
"""Candidates for m around the computed quotient, in units in the last place."""


def packed(plan: Plan) -> dict[str, Any]:
    """Return a plan in its recorded form."""
    found = {"robot": plan.robot, "key": plan.key, "seq": plan.seq}
    over = _shrinking(plan.increments)
    if over is None:
        return {**found, "increments": plan.increments}
    return {**found, "increment": plan.increments[0], "then": len(plan.increments) - 1, "over": over}


def unpacked(value: Mapping[str, Any]) -> Plan:
    """Return the plan of a recorded form.

    Raises:
        KeyError: A field is missing.
        ValueError: A field has a wrong type or value.
    """
    fields = dict(value)
    if "over" in fields:
        u, n, m = fields.pop("increment"), fields.pop("then"), fields.pop("over")
        if not 0 <= n * len(u) <= _LARGEST:
            raise ValueError(f"a plan of {n} increments; expected at most {_LARGEST} numbers")
        fields["increments"] = (u, *([x * (1.0 - k / m) for x in u] for k in range(1, n + 1)))
    return _PLAN.validate_python(fields)


def schema() -> dict[str, Any]:
    """Return the JSON Schema of a recorded plan."""
    whole: dict[str, Any] = _PLAN.json_schema()
    whole["required"].remove("increments")
    whole["properties"] |= {
        "increment": {"type": "array", "items": {"type": "number"}},
        "then": {"type": "integer"},
        "over": {"type": "number"},
    }
    return whole


def _shrinking(increments: tuple[Joints, ...]) -> float | None:
    """Return the m of increments u·(1 − k/m); None if they do not have this form."""
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
    # Compare bits: the sign of a zero matters.
    exact = ((u * shares[:, :, None]).view(np.int64) == rows[1:].view(np.int64)).all((1, 2))
    return float(near[exact.argmax()]) if exact.any() else None
