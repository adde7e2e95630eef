"""States of a recording by time, for viewers and reports, with random access."""

from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

from armgate.protocol import messages as m
from armgate.recording import codec
from armgate.recording.reader import Recording, check_entry, read_item
from armgate.recording.topics import STATE

_NS = 1_000_000_000
_KEPT = 64
"""Number of decoded chunks in the cache: several seconds around the requested time."""


@dataclass(slots=True)
class _Newest:
    """Newest entries and cell state up to some time."""

    entries: dict[str, m.Entry] = field(default_factory=dict)
    cell: codec.CellState | None = None

    def take(self, item: codec.Item) -> None:
        if isinstance(item, codec.RobotState):
            self.entries[item.entry.robot] = item.entry
        elif isinstance(item, codec.CellState):
            self.cell = item


class StateSeries:
    """Series of the states that the daemon sent to its clients.

    Each entry belongs to the newest tick of its robot. A call reads one or two chunks of 0.1 s each.

    Args:
        recording: The recording; it may be incomplete.
    """

    def __init__(self, recording: Recording) -> None:
        self.description = recording.description
        self.robots = tuple(robot.name for robot in self.description.robots)
        self._recording = recording
        self._places = [(part, place) for part in recording.parts for place in part.chunks]
        origin = recording.header.origin_ns
        self._starts = [(place.first_ns - origin) / _NS for _, place in self._places]
        self._ends = [(place.last_ns - origin) / _NS for _, place in self._places]
        self._cached = lru_cache(_KEPT)(self._read)

    @property
    def start(self) -> float:
        """Daemon time of the first message, s."""
        return self._starts[0]

    @property
    def end(self) -> float:
        """Daemon time of the last message, s."""
        return max(self._ends)

    def at(self, time: float) -> m.State | None:
        """Return the newest state at a daemon time [s]; None before the first state."""
        known = _Newest()
        # The times of adjacent chunks can overlap through log lines, so each item's own time is compared.
        last = bisect_right(self._starts, time) - 1
        for index in range(last, -1, -1):
            older = _Newest()
            for when, item in self._cached(index):
                if when <= time:
                    older.take(item)
            known.entries = older.entries | known.entries
            known.cell = known.cell or older.cell
            if known.cell is not None and len(known.entries) == len(self.robots):
                break
        return self._state(known)

    def all(self, robot: str | None = None) -> Iterator[m.State]:
        """Yield every state of the run, in order.

        Args:
            robot: Yield only the states at the ticks of this robot; None: at all ticks.
        """
        known = _Newest()
        for index in range(len(self._places)):
            for _, item in self._read(index):
                known.take(item)
                if isinstance(item, codec.CellState) and (robot is None or robot in item.ticks):
                    state = self._state(known, robot)
                    if state is not None:
                        yield state

    def _read(self, index: int) -> tuple[tuple[float, codec.Item], ...]:
        part, place = self._places[index]
        origin = self._recording.header.origin_ns
        found = []
        for topic, ns, data in part.reader.messages(place):
            if topic == STATE or topic.startswith("/robots/"):
                item = read_item(part.file, topic, data)
                if isinstance(item, codec.RobotState):
                    check_entry(part.file, self.description, item.entry)
                if item is not None:
                    found.append(((ns - origin) / _NS, item))
        return tuple(found)

    def _state(self, known: _Newest, robot: str | None = None) -> m.State | None:
        cell = known.cell
        if cell is None or not cell.ticks:
            return None
        robot = robot or list(cell.ticks)[-1]
        # A robot has no position before its first tick.
        entries = tuple(
            known.entries.get(name) or m.Entry(robot=name, tick=0, time=cell.time) for name in self.robots
        )
        more: dict[str, Any] = {} if cell.step is None else {"step": cell.step}
        return m.State.model_construct(
            robot=robot,
            tick=cell.ticks[robot],
            time=cell.time,
            entries=entries,
            signals=dict(cell.signals),
            warnings=tuple(cell.warnings),
            **more,
        )
