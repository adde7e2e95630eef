"""The states of a recording at any time, for viewers and reports: random access, whatever its length."""

from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

from armgate.protocol import messages as m
from armgate.recording import codec, form
from armgate.recording.reader import Part, Recording, check_entry, read_item
from armgate.recording.scan import Place

_NS = 1_000_000_000
_KEPT = 64
"""Chunks that are kept decoded: several seconds around the place that is looked at."""


@dataclass(slots=True)
class _Known:
    """The newest of everything, up to some time."""

    entries: dict[str, m.Entry] = field(default_factory=dict)
    moment: codec.Moment | None = None

    def take(self, item: codec.Item) -> None:
        if isinstance(item, codec.Shown):
            self.entries[item.entry.robot] = item.entry
        elif isinstance(item, codec.Moment):
            self.moment = item


class StateSeries:
    """What clients were shown, by time.

    An entry is the robot's at its own newest tick. A call reads a chunk or two (0.1 s of the run each).

    Args:
        recording: Which; it may break off.
    """

    def __init__(self, recording: Recording) -> None:
        self.description = recording.description
        self.robots = tuple(robot.name for robot in self.description.robots)
        self._recording = recording
        self._places = [(part, place) for part in recording.parts for place in part.chunks]
        origin = recording.header.origin_ns
        self._starts = [(place.first_ns - origin) / _NS for _, place in self._places]
        self._ends = [(place.last_ns - origin) / _NS for _, place in self._places]
        self._shown = lru_cache(_KEPT)(self._read)

    @property
    def start(self) -> float:
        """Daemon time of the beginning, s."""
        return self._starts[0]

    @property
    def end(self) -> float:
        """Daemon time of the end, s."""
        return max(self._ends)

    def at(self, time: float) -> m.State | None:
        """The state that was in force at a daemon time [s]; None before the first."""
        known = _Known()
        # Times of log lines may overlap by a chunk: the instants' own times decide.
        last = bisect_right(self._starts, time) - 1
        for index in range(last, -1, -1):
            older = _Known()
            for when, item in self._shown(index):
                if when <= time:
                    older.take(item)
            known.entries = older.entries | known.entries
            known.moment = known.moment or older.moment
            if known.moment is not None and len(known.entries) == len(self.robots):
                break
        return self._state(known)

    def all(self, robot: str | None = None) -> Iterator[m.State]:
        """Yield every state of the run, in order.

        Args:
            robot: Only the states at the ticks of this robot.
        """
        known = _Known()
        for index in range(len(self._places)):
            for _, item in self._read(index):
                known.take(item)
                if isinstance(item, codec.Moment) and (robot is None or robot in item.ticks):
                    state = self._state(known, robot)
                    if state is not None:
                        yield state

    def _read(self, index: int) -> tuple[tuple[float, codec.Item], ...]:
        part: Part
        place: Place
        part, place = self._places[index]
        origin = self._recording.header.origin_ns
        found = []
        for topic, ns, data in part.reader.messages(place):
            if topic == form.STATE or topic.startswith("/robots/"):
                item = read_item(part.file, topic, data)
                if isinstance(item, codec.Shown):
                    check_entry(part.file, self.description, item.entry)
                if item is not None:
                    found.append(((ns - origin) / _NS, item))
        return tuple(found)

    def _state(self, known: _Known, robot: str | None = None) -> m.State | None:
        moment = known.moment
        if moment is None or not moment.ticks:
            return None
        robot = robot or list(moment.ticks)[-1]
        # Before its first tick nothing is known of a robot.
        entries = tuple(
            known.entries.get(name) or m.Entry(robot=name, tick=0, time=moment.time) for name in self.robots
        )
        more: dict[str, Any] = {} if moment.step is None else {"step": moment.step}
        return m.State.model_construct(
            robot=robot,
            tick=moment.ticks[robot],
            time=moment.time,
            entries=entries,
            signals=dict(moment.signals),
            warnings=tuple(moment.warnings),
            **more,
        )
