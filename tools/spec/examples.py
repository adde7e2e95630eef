"""Messages for the vectors: of each type a minimal and a complete one, and values at the bounds."""

import math
from collections.abc import Iterator
from typing import Any

from armgate.protocol import messages as m

HASH = "0123456789abcdef" * 4
POINT = [0.5, -1.25, 2.0]
UPRIGHT = [0.0, 0.0, 0.0, 1.0]
LIMITS = {
    "inbound": 65536, "outbound": 1048576, "max_age_ticks": 3, "lease_ttl": 1.0, "signals": 64,
    "signal_rate": 1000.0,
}  # fmt: skip
JOINT = {
    "name": "A1", "kind": "revolute", "unit": "rad", "lower": -3.0, "upper": 3.0, "velocity": 2.7,
    "acceleration": 10.8, "deceleration": None,
}  # fmt: skip
BODY = {
    "name": "FR/link_3", "robot": "FR", "link": "link_3",
    "shape": {"kind": "capsule", "size": [0.125, 0.75]}, "xyz": POINT, "xyzw": UPRIGHT,
}  # fmt: skip
FLOOR = BODY | {
    "name": "floor",
    "robot": None,
    "link": None,
    "shape": {"kind": "box", "size": [6.0, 6.0, 0.2]},
}
TANK = FLOOR | {
    "name": "tank",
    "exact": {
        "kind": "convex", "size": [], "radius": 0.001,
        "mesh": {"hash": HASH, "size": 2048, "media": "model/obj"},
    },
}  # fmt: skip
ROBOT = {
    "name": "FR", "urdf": {"hash": HASH, "size": 8192, "media": "application/xml"}, "joints": [JOINT],
    "base_xyz": POINT, "base_xyzw": UPRIGHT, "period": 0.012, "start": [0.25],
    "frames": ["base", "link_3", "tool0"], "tool": "tool0", "camera": None,
}  # fmt: skip
NEAREST = {"pair": ["FR/link_3", "GR/link_5"], "distance": 0.75, "limit": 0.05, "points": [POINT, POINT]}
REASON = {
    "cause": "clearance", "text": "FR/link_3 and GR/link_5: 41.5 mm could be proven", "joint": None,
    "pair": NEAREST["pair"], "value": 0.0415, "bound": 0.05, "points": NEAREST["points"],
}  # fmt: skip
ENTRY = {
    "robot": "FR", "tick": 1200, "time": 14.4, "q": [0.25], "setpoint": [0.26], "applied_seq": None,
    "stop_end": [0.27], "nearest": [NEAREST], "least_clearance": 0.5, "holder": None, "stops": [2],
    "link": "ready", "verdict": {"seq": 41, "outcome": "refused", "cause": "stale", "text": "too old"},
    "counts": {"admitted": 7, "refused:stale": 1}, "late_commands": 0,
}  # fmt: skip

EXAMPLES: dict[str, Any] = {
    "id": 17, "re": 17, "versions": [1], "client_versions": [1, 2], "version": 1, "name": "wave",
    "role": "operator", "token": "armgate_not-a-real-one", "capabilities": ["lights"], "software": "mine 1.0",
    "hash": HASH, "offset": 4096, "length": 65536, "robot": "FR", "takeover": True, "speed": 0.5, "fence": 7,
    "seq": 42, "tick": 1200, "dq": [0.001, -0.002, 0.0], "deadline": 14.5, "horizon": 2, "step": 1200,
    "every": 2, "robots": ["FR", "GR"], "fields": ["q", "holder"], "value": [1.5, -0.25], "reason": "enough",
    "stop": 2, "replaces": 1, "lifted": 3,
    "time": 14.4, "start": "5f1c0a9e", "session": "s4", "lockstep": True, "limits": LIMITS,
    "stop_distance": 0.05, "self_distance": 0.02, "response": "stop", "bodies": [BODY, FLOOR, TANK],
    "total": 8192, "data": b"<robot>\x00\xff", "state": "held", "ttl": 1.0, "target": 1201,
    "outcome": "limited", "beta": 0.75, "setpoint": [0.26], "reasons": [REASON], "entries": [ENTRY],
    "signals": {"zoom": {"owner": "lead", "value": [1.0], "time": 14.25}}, "warnings": ["a tick came late"],
    "by": "wave", "received": 14.5, "sent": 14.5, "code": "leased", "text": "FR is held by lead",
    "fatal": False, "about": "acquire",
    "sessions": [
        {"session": "s4", "name": "wave", "role": "controller", "token": "lab", "address": "192.0.2.7:4711",
         "robots": ["FR"]},
        {"session": "s5", "name": "e", "role": "observer", "token": None, "address": "uid 7", "robots": []},
    ],
}  # fmt: skip
"""Example value of each field, the same in every message."""

OWN: dict[str, dict[str, Any]] = {"description": {"name": "demo", "robots": [ROBOT]}}
"""Example values of fields that have another form in one message."""

LONGEST = "x" * 64
MOST = 2**63 - 1
AT = {"robot": "FR", "fence": 7, "seq": 42, "tick": 1200}
COMMAND: dict[str, Any] = {"type": "command", **AT, "dq": [0.0]}
BOUNDS: list[tuple[str, dict[str, Any]]] = [
    ("a dq of NaN, infinities and zeros", COMMAND | {"dq": [math.nan, math.inf, -math.inf, 0.0, -0.0]}),
    ("a dq of very small and very large numbers", COMMAND | {"dq": [5e-324, 1.7976931348623157e308]}),
    ("a dq for no joints", COMMAND | {"dq": []}),
    ("a dq for 64 joints", COMMAND | {"dq": [0.5] * 64}),
    ("the largest counts", COMMAND | {"fence": MOST, "seq": MOST, "tick": MOST}),
    ("the smallest counts", COMMAND | {"fence": 0, "seq": 0, "tick": 0}),
    ("the largest id", {"type": "ping", "id": 2**31 - 1, "time": 0.0}),
    ("the longest name", {"type": "acquire", "robot": LONGEST}),
    ("every character of names", {"type": "acquire", "robot": "azAZ09_.:/-"}),
    ("the smallest speed", {"type": "acquire", "robot": "FR", "speed": 5e-324}),
    ("the longest text, of more bytes than characters", {"type": "stop", "reason": "é" * 512}),
    ("a text with every kind of character", {"type": "bye", "reason": "\x00\n\"\\ ü 漢 🤖"}),
    ("every version", {"type": "hello", "versions": [1, 65536, *range(2, 16)], "name": "wave"}),
    ("the most numbers of a signal", {"type": "signal", "name": "zoom", "value": [0.25] * 16}),
    ("a subscription with all fields", {"type": "subscribe", "every": 10000, "robots": None, "fields": None}),
    ("a subscription without states", {"type": "subscribe", "every": 0, "robots": [], "fields": []}),
    ("the smallest piece of an asset", {"type": "asset", "hash": HASH, "offset": MOST, "length": 1}),
]  # fmt: skip


def messages() -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Yield side, name and value of every message of the vectors."""
    for side, models in (("client", m.CLIENT_MESSAGES), ("server", m.SERVER_MESSAGES)):
        for model in models:
            kind = model.model_fields["type"].default
            values = EXAMPLES | OWN.get(kind, {})
            least = {key: values[key] for key, field in model.model_fields.items() if field.is_required()}
            whole = {key: values[key] for key in model.model_fields if key != "type"}
            yield side, f"{kind}: minimal", {"type": kind, **least}
            yield side, f"{kind}: complete", {"type": kind, **whole}
    for name, value in BOUNDS:
        yield "client", f"{value['type']}: {name}", value
