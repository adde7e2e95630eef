"""Topics, schemas and the header: what any reader of a recording may count on.

A file is MCAP with the profile ``armgate``. Its messages are JSON; each topic has a JSON Schema, so that
general tools show them. The first message, on ``/run``, is the header. A message's log time is the time of
day at daemon time 0 plus the daemon time of what it tells; messages stand in the order of what happened.
"""

import base64
import hashlib
import json
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, TypeAdapter

from armgate import events as e
from armgate.protocol import messages as m
from armgate.recording import plans

FORMAT = 1
"""Raised when readers of the one before would misread a file; mere additions do not raise it."""

PROFILE = "armgate"
METADATA = "armgate"
"""Name of the metadata record that says the format before anything else."""

SEAL = "armgate.seal"
"""Name of the metadata record that ends the hash chain of a closed file."""

END = "armgate.end"
"""Name of the metadata record before the seal that states if another part follows."""

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
"""What the gate is told, by the last part of the topic ``/gate/…``."""

OUTPUTS: dict[str, type] = {
    "verdict": e.Verdict,
    "plan": e.Plan,
    "stopped": e.Stopped,
    "reset_answer": e.ResetAnswer,
    "rebase": e.Rebase,
}
"""What the gate answers, by the key under which it stands."""


_LATEST_NS = 253_402_300_799 * 10**9
"""The end of the year 9999, ns since 1970."""


def _base64(files: dict[str, str]) -> dict[str, str]:
    for name, text in files.items():
        try:
            base64.b64decode(text, validate=True)
        except ValueError as error:
            raise ValueError(f"{name[:60]!r} is not in base64") from error
    return files


Packed = Annotated[dict[str, str], AfterValidator(_base64)]
"""Contents of files by name, in base64."""


class Header(BaseModel):
    """What a recording is of, in every part of it.

    Attributes:
        format: The form of the recording.
        part: Number of this file, from 1.
        start: The daemon's start id.
        previous: Seal of the part before, in hexadecimal digits; empty in the first part.
        origin_ns: Time of day at daemon time 0, ns since 1970.
        cell: The cell's name.
        hash: The cell's hash, as the description tells it.
        lockstep: Whether time passed in lock-step.
        judge: How the gate computed: ``numpy`` or ``compiled``.
        software: Versions by package.
        machine: What the computed bits may depend on beside the software.
        files: A folder in itself from which the cell can be built again: file names and contents (base64);
            ``config.yaml`` is the configuration.
        description: What clients are told of the cell.
        assets: What the description names by its hash (base64).
    """

    model_config = ConfigDict(frozen=True)

    format: int = FORMAT
    part: int = 1
    start: str
    previous: str = ""
    origin_ns: Annotated[int, Field(ge=0, le=_LATEST_NS)]
    cell: str
    hash: str
    lockstep: bool
    judge: str = "numpy"
    software: dict[str, str] = Field(default_factory=dict)
    machine: dict[str, str] = Field(default_factory=dict)
    files: Packed = Field(default_factory=dict)
    description: dict[str, Any] = Field(default_factory=dict)
    assets: Packed = Field(default_factory=dict)

    def file(self, name: str) -> bytes:
        """The content of one of the files.

        Raises:
            KeyError: There is none of this name.
        """
        return base64.b64decode(self.files[name])

    def asset(self, hash_: str) -> bytes:
        """Return what the description names by this SHA-256.

        Raises:
            KeyError: It names none such.
            ValueError: What is kept under the hash is something else.
        """
        data = base64.b64decode(self.assets[hash_])
        if hashlib.sha256(data).hexdigest() != hash_:
            raise ValueError(f"the asset {hash_[:12]}… is not what its hash says")
        return data


def metadata(header: Header) -> dict[str, str]:
    """Return the metadata that a file begins with."""
    said = {"format": header.format, "start": header.start, "part": header.part, "hash": header.hash}
    return {key: str(value) for key, value in said.items()}


def end(last: bool) -> dict[str, str]:
    """Return the metadata that states if a file ends the recording, or is followed by another part."""
    return {"last": "true" if last else "false"}


def robot_topic(robot: str) -> str:
    """The topic of one robot's states."""
    return f"/robots/{robot}/state"


def topics(header: Header) -> list[str]:
    """All topics of a recording."""
    robots = [robot_topic(robot["name"]) for robot in header.description.get("robots", ())]
    return [RUN, *(f"/gate/{kind}" for kind in EVENTS), STATE, *robots, LOG, GAP, CHAIN]


def schema_of(topic: str) -> tuple[str, bytes]:
    """Name and JSON Schema of the messages on a topic."""
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
    """An event and the outputs that it led to, each under a key of its kind."""
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
