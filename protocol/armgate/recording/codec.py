"""Items of a recording and their JSON encoding, exact to the last bit, the sign of zero included.

JSON has neither NaN nor infinity: they are encoded as the strings ``NaN``, ``Infinity`` and ``-Infinity``.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, assert_never

from pydantic import TypeAdapter, ValidationError
from pydantic_core import from_json, to_json

from armgate.events import GateEvent, GateOutput, Plan
from armgate.protocol import messages as m
from armgate.recording import plans
from armgate.recording.errors import first_problem
from armgate.recording.topics import EVENTS, GAP, LOG, OUTPUTS, STATE, robot_topic

_LEVELS = {"info": 2, "warning": 3, "error": 4}
_LEVEL_NAMES = {number: name for name, number in _LEVELS.items()}


@dataclass(frozen=True, slots=True)
class Step:
    """Event of the gate and the outputs that it caused."""

    event: GateEvent
    outputs: Sequence[GateOutput]


@dataclass(frozen=True, slots=True)
class RobotState:
    """Entry of one robot in the state at its own tick.

    Lower bounds are rounded down to 1 µm, points are rounded to 0.1 mm.
    """

    entry: m.Entry


@dataclass(frozen=True, slots=True)
class CellState:
    """State of the cell at one instant, without the robots' entries.

    Attributes:
        time: Daemon time, s.
        step: Number of the step in lock-step; None by the wall clock.
        ticks: Tick numbers by robot, of the robots that ticked.
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
    """Line of the daemon's log: time of day [s since 1970], level, event, and its fields."""

    time: float
    level: str
    event: str
    fields: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Gap:
    """Number of records that the recorder lost here, and how many of them were events of the gate."""

    records: int
    steps: int


Item = Step | RobotState | CellState | LogLine | Gap

_EVENT_TOPICS = {model: f"/gate/{name}" for name, model in EVENTS.items()}
_OUTPUT_NAMES = {model: name for name, model in OUTPUTS.items()}
_EVENTS = {name: TypeAdapter[Any](model) for name, model in EVENTS.items()}
_OUTPUTS = {name: TypeAdapter[Any](model) for name, model in OUTPUTS.items()}
_CELL_STATE, _LOG, _GAP = TypeAdapter(CellState), TypeAdapter(LogLine), TypeAdapter(Gap)


def encode(item: Item) -> tuple[str, bytes]:
    """Return the topic of an item, and its JSON."""
    topic, value = _topic_and_value(item)
    return topic, to_json(value, inf_nan_mode="strings")


def decode(topic: str, data: bytes) -> Item | None:
    """Return the item in a message; None if the topic is unknown, because a later version added it.

    Raises:
        ValueError: The message does not have the form of its topic.
    """
    try:
        if topic.startswith("/gate/"):
            return _step(topic.removeprefix("/gate/"), from_json(data))
        if topic.startswith("/robots/"):
            return RobotState(m.Entry.model_validate_json(data))
        reader = _READERS.get(topic)
        return None if reader is None else reader(from_json(data))
    except ValidationError as error:
        raise ValueError(f"a message on {topic[:100]!r}: {first_problem(error)}") from error
    except (KeyError, TypeError, AttributeError, ArithmeticError) as error:
        raise ValueError(f"a message on {topic[:100]!r} does not have the form of this topic") from error
    except ValueError as error:
        raise ValueError(f"a message on {topic[:100]!r}: {error!s:.200}") from error


# --- items to JSON values ---------------------------------------------------------------------------------


def _topic_and_value(item: Item) -> tuple[str, object]:
    match item:
        case Step():
            return _EVENT_TOPICS[type(item.event)], _step_value(item)
        case RobotState(entry=entry):
            return robot_topic(entry.robot), _entry_value(entry)
        case CellState():
            return STATE, item
        case LogLine():
            return LOG, _log_value(item)
        case Gap():
            return GAP, item
        case _:
            assert_never(item)


def _step_value(step: Step) -> object:
    outputs = [{_OUTPUT_NAMES[type(o)]: plans.packed(o) if isinstance(o, Plan) else o} for o in step.outputs]
    return {"event": step.event, "outputs": outputs}


def rounded(entry: m.Entry) -> m.Entry:
    """Return an entry with the precision of a recording: see `RobotState`."""
    # Digits below these bounds would fill a third of a recording, without information for a reader.
    nearest = entry.nearest and tuple([m.Nearest.model_construct(**near) for near in _nearest(entry.nearest)])
    least = entry.least_clearance and _down(entry.least_clearance)
    return entry.model_copy(update={"nearest": nearest, "least_clearance": least})


def _nearest(pairs: Sequence[m.Nearest]) -> list[dict[str, Any]]:
    """Return the fields of nearest pairs, rounded."""
    return [
        {
            "pair": near.pair,
            "distance": _down(near.distance),
            "limit": near.limit,
            "points": near.points and (_rounded_point(near.points[0]), _rounded_point(near.points[1])),
        }
        for near in pairs
    ]


def _rounded_point(point: tuple[float, float, float]) -> tuple[float, float, float]:
    x, y, z = point
    return round(x, 4), round(y, 4), round(z, 4)


def _entry_value(entry: m.Entry) -> object:
    # As `rounded`, without models: they would take most of the time of a recording.
    return {
        **entry.__dict__,
        "nearest": entry.nearest and _nearest(entry.nearest),
        "least_clearance": entry.least_clearance and _down(entry.least_clearance),
    }


def _down(bound: float) -> float:
    """Round a lower bound down to the micrometre: the result is still a lower bound."""
    return math.floor(bound * 1e6) / 1e6


def _log_value(line: LogLine) -> object:
    sec = int(line.time)
    stamp = {"sec": sec, "nsec": round((line.time - sec) * 1e9)}
    return {
        "timestamp": stamp,
        "level": _LEVELS[line.level],
        "message": line.event,
        "name": "armgate",
        "file": "",
        "line": 0,
        "fields": line.fields,
    }


# --- JSON values to items ---------------------------------------------------------------------------------


def _step(kind: str, value: Any) -> Step | None:
    if kind not in _EVENTS:
        return None
    outputs = []
    for output in value["outputs"]:
        ((name, given),) = output.items()
        read = plans.unpacked if name == "plan" else _OUTPUTS[name].validate_python
        outputs.append(read(given))
    return Step(_EVENTS[kind].validate_python(value["event"]), tuple(outputs))


def _cell_state(value: Any) -> CellState:
    # Validate JSON: in JSON mode a strict model accepts a list as a tuple.
    state = _CELL_STATE.validate_json(to_json(value))
    return replace(state, warnings=tuple(state.warnings))


def _log(value: Any) -> LogLine:
    stamp = value["timestamp"]
    level = _LEVEL_NAMES.get(value["level"], "info")
    time = stamp["sec"] + stamp["nsec"] / 1e9
    return _LOG.validate_python(
        {"time": time, "level": level, "event": value["message"], "fields": value["fields"]}
    )


def _gap(value: Any) -> Gap:
    return _GAP.validate_python(value)


_READERS: dict[str, Callable[[Any], Item]] = {STATE: _cell_state, LOG: _log, GAP: _gap}
