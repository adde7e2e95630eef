"""What a recording holds, to and from JSON: exact to the last bit, the sign of zero included.

JSON knows neither NaN nor infinity: they stand as the texts ``NaN``, ``Infinity`` and ``-Infinity``.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from pydantic import TypeAdapter, ValidationError
from pydantic_core import from_json, to_json

from armgate.events import GateEvent, GateOutput, Plan
from armgate.protocol import messages as m
from armgate.recording import form, plans
from armgate.recording.errors import first_problem

_LEVELS = {"info": 2, "warning": 3, "error": 4}
_LEVEL_NAMES = {number: name for name, number in _LEVELS.items()}


@dataclass(frozen=True, slots=True)
class Step:
    """An event with what the gate answered."""

    event: GateEvent
    outputs: Sequence[GateOutput]


@dataclass(frozen=True, slots=True)
class Shown:
    """A robot's entry in the state at its own tick; bounds are kept to 1 µm (down), points to 0.1 mm."""

    entry: m.Entry


@dataclass(frozen=True, slots=True)
class Moment:
    """What beside the robots' entries stands in the state of an instant.

    Attributes:
        time: Daemon time, s.
        step: Number of the instant in lock-step.
        ticks: The robots that ticked, and their ticks.
        signals: All signals by name.
        warnings: All warnings.
    """

    time: float
    step: int | None
    ticks: Mapping[str, int]
    signals: Mapping[str, m.SignalValue]
    warnings: Sequence[str]


@dataclass(frozen=True, slots=True)
class LogLine:
    """A line of the daemon's log: time of day [s since 1970], level, event, and its fields."""

    time: float
    level: str
    event: str
    fields: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Gap:
    """The recorder lost so many records here, so many of them events of the gate."""

    records: int
    steps: int


Item = Step | Shown | Moment | LogLine | Gap

_EVENT_NAMES = {model: name for name, model in form.EVENTS.items()}
_OUTPUT_NAMES = {model: name for name, model in form.OUTPUTS.items()}
_EVENTS = {name: TypeAdapter[Any](model) for name, model in form.EVENTS.items()}
_OUTPUTS = {name: TypeAdapter[Any](model) for name, model in form.OUTPUTS.items()}
_MOMENT, _LOG, _GAP = TypeAdapter(Moment), TypeAdapter(LogLine), TypeAdapter(Gap)
_STEP_TOPICS = {model: f"/gate/{name}" for model, name in _EVENT_NAMES.items()}


def encode(item: Item) -> tuple[str, bytes]:
    """The topic of an item, and its JSON."""
    topic, value = _ENCODERS[type(item)](item)
    return topic, to_json(value, inf_nan_mode="strings")


def decode(topic: str, data: bytes) -> Item | None:
    """The item in a message; None if the topic is not known (it was added later).

    Raises:
        ValueError: The message is not what this topic holds.
    """
    try:
        if topic.startswith("/gate/"):
            return _step(topic.removeprefix("/gate/"), from_json(data))
        if topic.startswith("/robots/"):
            return Shown(m.Entry.model_validate_json(data))
        reader = _READERS.get(topic)
        return None if reader is None else reader(from_json(data))
    except ValidationError as error:
        raise ValueError(f"a message on {topic[:100]!r}: {first_problem(error)}") from error
    except (KeyError, TypeError, AttributeError, ArithmeticError) as error:
        raise ValueError(f"a message on {topic[:100]!r} has not the form of this topic") from error
    except ValueError as error:
        raise ValueError(f"a message on {topic[:100]!r}: {error!s:.200}") from error


def _encode_step(step: Step) -> tuple[str, object]:
    outputs = [{_OUTPUT_NAMES[type(o)]: plans.packed(o) if isinstance(o, Plan) else o} for o in step.outputs]
    return _STEP_TOPICS[type(step.event)], {"event": step.event, "outputs": outputs}


def _encode_shown(shown: Shown) -> tuple[str, object]:
    entry = shown.entry
    fields: dict[str, object] = dict(entry.__dict__)
    # A third of a recording would be digits below these, which nobody can see.
    fields["nearest"] = entry.nearest and [
        {
            "pair": near.pair,
            "distance": _down(near.distance),
            "limit": near.limit,
            "points": near.points and [[round(x, 4) for x in point] for point in near.points],
        }
        for near in entry.nearest
    ]
    fields["least_clearance"] = entry.least_clearance and _down(entry.least_clearance)
    return form.robot_topic(entry.robot), fields


def _down(bound: float) -> float:
    """A lower bound to the micrometre: never more than it was."""
    return math.floor(bound * 1e6) / 1e6


def _encode_moment(moment: Moment) -> tuple[str, object]:
    return form.STATE, moment


def _encode_log(line: LogLine) -> tuple[str, object]:
    sec = int(line.time)
    stamp = {"sec": sec, "nsec": round((line.time - sec) * 1e9)}
    return form.LOG, {
        "timestamp": stamp,
        "level": _LEVELS[line.level],
        "message": line.event,
        "name": "armgate",
        "file": "",
        "line": 0,
        "fields": line.fields,
    }


def _encode_gap(gap: Gap) -> tuple[str, object]:
    return form.GAP, gap


_ENCODERS: dict[type, Callable[[Any], tuple[str, object]]] = {
    Step: _encode_step,
    Shown: _encode_shown,
    Moment: _encode_moment,
    LogLine: _encode_log,
    Gap: _encode_gap,
}


def _step(kind: str, value: Any) -> Step | None:
    if kind not in _EVENTS:
        return None
    outputs = []
    for output in value["outputs"]:
        ((name, given),) = output.items()
        read = plans.unpacked if name == "plan" else _OUTPUTS[name].validate_python
        outputs.append(read(given))
    return Step(_EVENTS[kind].validate_python(value["event"]), tuple(outputs))


def _moment(value: Any) -> Moment:
    # By way of JSON, in which a list is a tuple even where types are strict.
    moment = _MOMENT.validate_json(to_json(value))
    return replace(moment, warnings=tuple(moment.warnings))


def _log(value: Any) -> LogLine:
    stamp = value["timestamp"]
    level = _LEVEL_NAMES.get(value["level"], "info")
    time = stamp["sec"] + stamp["nsec"] / 1e9
    return _LOG.validate_python(
        {"time": time, "level": level, "event": value["message"], "fields": value["fields"]}
    )


def _gap(value: Any) -> Gap:
    return _GAP.validate_python(value)


_READERS: dict[str, Callable[[Any], Item]] = {form.STATE: _moment, form.LOG: _log, form.GAP: _gap}
