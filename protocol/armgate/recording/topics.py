"""Topics of a recording and their JSON Schemas.

Messages are JSON; each topic has a JSON Schema, so that general MCAP tools can display it. The first message,
on ``/run``, is the header. The log time of a message is the time of day at daemon time 0 plus the daemon time
of its content. Messages are in the order of the events.
"""

import json
from functools import lru_cache
from typing import Any

from pydantic import TypeAdapter

from armgate import events as e
from armgate.protocol import messages as m
from armgate.recording import plans
from armgate.recording.header import Header

RUN, STATE, LOG, GAP, CHAIN = "/run", "/state", "/log", "/gap", "/chain"

EVENTS: dict[str, type] = {
    "tick": e.Tick,
    "command": e.Command,
    "plan_answer": e.PlanAnswer,
    "lease": e.LeaseChange,
    "stop": e.Stop,
    "reset": e.Reset,
    "link": e.LinkChange,
}
"""Events of the gate by the last part of their topic ``/gate/…``."""

OUTPUTS: dict[str, type] = {
    "verdict": e.Verdict,
    "plan": e.Plan,
    "stopped": e.Stopped,
    "reset_answer": e.ResetAnswer,
    "rebase": e.Rebase,
}
"""Outputs of the gate by their key in a message."""


def robot_topic(robot: str) -> str:
    """Return the topic of one robot's states."""
    return f"/robots/{robot}/state"


def all_topics(header: Header) -> list[str]:
    """Return all topics of a recording."""
    robots = [robot_topic(robot["name"]) for robot in header.description.get("robots", ())]
    return [RUN, *(f"/gate/{kind}" for kind in EVENTS), STATE, *robots, LOG, GAP, CHAIN]


@lru_cache(256)
def schema_of(topic: str) -> tuple[str, bytes]:
    """Return name and JSON Schema of the messages on a topic."""
    name, schema = _schema_of(topic)
    return name, json.dumps(schema, separators=(",", ":")).encode()


def _schema_of(topic: str) -> tuple[str, dict[str, Any]]:
    if topic == RUN:
        return "armgate.Header", Header.model_json_schema()
    if topic in _FIXED:
        return _FIXED[topic]
    if topic.startswith("/robots/"):
        return "armgate.Entry", m.Entry.model_json_schema()
    kind = topic.rpartition("/")[2]
    return f"armgate.{EVENTS[kind].__name__}", _step_schema(kind)


def _step_schema(kind: str) -> dict[str, Any]:
    """Return the schema of an event and its outputs, each under a key of its kind."""
    definitions: dict[str, Any] = {}

    def of(model: type) -> dict[str, Any]:
        schema = TypeAdapter(model).json_schema()
        definitions.update(schema.pop("$defs", {}))
        return schema

    outputs = {name: of(model) for name, model in OUTPUTS.items() if model is not e.Plan}
    outputs["plan"] = plans.schema()
    definitions.update(outputs["plan"].pop("$defs"))
    event = of(EVENTS[kind])
    each = {"type": "object", "properties": outputs, "maxProperties": 1}
    properties = {"event": event, "outputs": {"type": "array", "items": each}}
    return {"type": "object", "properties": properties, "$defs": definitions}


def _numbers(*names: str) -> dict[str, Any]:
    return {"type": "object", "properties": {name: {"type": "integer"} for name in names}}


_SIGNAL = {
    "type": "object",
    "properties": {
        "owner": {"type": "string"},
        "value": {"type": "array", "items": {"type": "number"}},
        "time": {"type": "number"},
    },
}
_STATE: dict[str, Any] = {
    "type": "object",
    "properties": {
        "time": {"type": "number"},
        "step": {"type": ["integer", "null"]},
        "ticks": {"type": "object", "additionalProperties": {"type": "integer"}},
        "signals": {"type": "object", "additionalProperties": _SIGNAL},
        "warnings": {"type": "array", "items": {"type": "string"}},
    },
}
_STAMP = {"type": "object", "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}}}
_LOG: dict[str, Any] = {
    "type": "object",
    "title": "foxglove.Log",
    "properties": {
        "timestamp": _STAMP,
        "level": {"type": "integer"},
        "message": {"type": "string"},
        "name": {"type": "string"},
        "file": {"type": "string"},
        "line": {"type": "integer"},
        "fields": {"type": "object"},
    },
}
_FIXED: dict[str, tuple[str, dict[str, Any]]] = {
    LOG: ("foxglove.Log", _LOG),
    STATE: ("armgate.State", _STATE),
    GAP: ("armgate.Gap", _numbers("records", "steps")),
    CHAIN: ("armgate.Link", {"type": "object", "properties": {"sha256": {"type": "string"}}}),
}
