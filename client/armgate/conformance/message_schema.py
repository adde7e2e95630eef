"""Schema of every message of the server, written down independently of the protocol package.

``name:kind`` is a required key, ``name?:kind`` one that may be left out or be nil. Kinds: ``id``, ``count``,
``num`` (finite), ``share`` (above 0, at most 1), ``unit`` (0 to 1), ``bool``, ``text``, ``name``, ``hash``,
``bin``, ``nil``; ``[k]`` is an array, ``{k}`` a map from names, ``a|b`` one of the literals or kinds; a name
with a capital letter is a map of ``MAPS``.
"""

import math
import re
from collections.abc import Iterator
from typing import Any

from armgate.conformance.codec import Fields

MESSAGES = {
    "welcome": "re?:id version:count versions:[count] client_versions:[count] capabilities?:[name] "
    "start:name session:name name:name role:observer|controller|operator lockstep?:bool limits:Limits "
    "software?:text",
    "description": "re?:id name:text hash:hash stop_distance:num self_distance:num response:stop|slow "
    "lockstep:bool robots:[Robot] bodies:[Body]",
    "chunk": "re?:id hash:hash offset:count total:count data:bin",
    "lease": "re?:id robot:name fence:count state:held|released|lost ttl:num speed?:share reason?:text",
    "verdict": "robot:name seq:count tick:count target:count|nil outcome:admitted|limited|refused beta:unit "
    "dq:[num] setpoint:[num] reasons?:[Reason]",
    "state": "re?:id robot:name tick:count time:num step?:count entries:[Entry] signals?:{Signal} "
    "warnings?:[text]",
    "subscribed": "re?:id every:count robots:[name] fields:[name]",
    "signaled": "re?:id name:name",
    "stopped": "re?:id stop:count robots:[name] reason:text by:name replaces?:count",
    "resumed": "re?:id stop:count by:name lifted?:count",
    "pong": "re?:id time:num received:num sent:num",
    "error": "re?:id code:name text:text fatal:bool about?:name seq?:count",
    "bye": "reason?:text",
    "session_list": "re?:id sessions:[Session]",
    "kicked": "re?:id session:name",
}

MAPS = {
    "Limits": "inbound:count outbound:count max_age_ticks:count lease_ttl:num signals:count signal_rate:num",
    "Robot": "name:name urdf:Asset joints:[Joint] base_xyz:[num] base_xyzw:[num] period:num start:[num] "
    "frames:[name] tool:name camera:name|nil",
    "Asset": "hash:hash size:count media:text",
    "Joint": "name:name kind:revolute|prismatic unit:rad|m lower:num upper:num velocity:num acceleration:num "
    "deceleration:num|nil",
    "Body": "name:name robot:name|nil link:name|nil shape:Shape xyz:[num] xyzw:[num]",
    "Shape": "kind:sphere|capsule|cylinder|box size:[num]",
    "Reason": "cause:name text:text joint?:name pair?:[name] value?:num bound?:num points?:[[num]]",
    "Entry": "robot:name tick:count time:num q?:[num] setpoint?:[num] applied_seq?:count stop_end?:[num] "
    "nearest?:[Nearest] least_clearance?:num holder?:name stops?:[count] link?:waiting|ready|lost|faulted "
    "verdict?:Last counts?:{count} late_commands?:count",
    "Nearest": "pair:[name] distance:num limit:num points?:[[num]]",
    "Last": "seq:count outcome:admitted|limited|refused cause?:name text?:text",
    "Session": "session:name name:name role:observer|controller|operator token:name|nil address:text "
    "robots:[name]",
    "Signal": "owner:name value:[num] time:num",
}

_TYPES = {"nil": type(None), "bool": bool, "text": str, "bin": bytes}
_NAME = re.compile(r"[A-Za-z0-9_.:/-]{1,64}")
_HASH = re.compile(r"[0-9a-f]{64}")


def schema_errors(message: Fields) -> Iterator[str]:
    """Yield the deviations of a message of the server from its schema.

    The kit announces no capability that adds message types, so a type that is not in ``MESSAGES`` must not
    come (EVO-4).
    """
    kind = message.get("type")
    if not isinstance(kind, str):
        yield f"a message whose type is {kind!r}"
    elif kind not in MESSAGES:
        yield f"a message of type {kind[:60]!r}, for which the kit announced no capability"
    else:
        yield from _map_errors(kind, MESSAGES[kind], message)


def _map_errors(where: str, schema: str, value: Fields) -> Iterator[str]:
    for part in schema.split():
        key, _, kind = part.partition(":")
        name = key.rstrip("?")
        if name not in value:
            if name == key:
                yield f"{where}.{name} is missing"
        elif not (value[name] is None and name != key):
            yield from _value_errors(f"{where}.{name}", kind, value[name])


def _value_errors(where: str, kind: str, value: Any) -> Iterator[str]:
    if kind[0] in "[{":
        yield from _item_errors(where, kind, value)
    elif kind in MAPS:
        if isinstance(value, dict):
            yield from _map_errors(where, MAPS[kind], value)
        else:
            yield f"{where} is {value!r}, not a map"
    elif not any(_is(one, value) for one in kind.split("|")):
        yield f"{where} is {str(value)[:60]!r}; expected {kind}"


def _item_errors(where: str, kind: str, value: Any) -> Iterator[str]:
    inner = kind[1:-1]
    if not isinstance(value, list if kind[0] == "[" else dict):
        yield f"{where} is {value!r}; expected {'an array' if kind[0] == '[' else 'a map'}"
        return
    for key, item in enumerate(value) if isinstance(value, list) else value.items():
        yield from _value_errors(f"{where}[{key}]", inner, item)


def _is(kind: str, value: Any) -> bool:
    if kind in ("id", "count"):
        return type(value) is int and 0 <= value < 2 ** (31 if kind == "id" else 63)
    if kind in ("num", "share", "unit"):
        return type(value) in (int, float) and math.isfinite(value) and _within(kind, value)
    if kind in ("name", "hash"):
        pattern = _NAME if kind == "name" else _HASH
        return isinstance(value, str) and pattern.fullmatch(value) is not None
    if kind in _TYPES:
        return type(value) is _TYPES[kind]
    return bool(value == kind)


def _within(kind: str, value: float) -> bool:
    if kind == "share":
        return 0.0 < value <= 1.0
    return kind == "num" or 0.0 <= value <= 1.0
