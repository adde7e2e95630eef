"""Series of one trial: motion of the robots and decisions of the gate, from a world or from a recording."""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from armgate.cell.cell import Cell
from armgate.events import GateEvent, GateOutput, LeaseChange, Verdict
from armgate.protocol import messages as m
from armgate.recording import Recording
from armgate.recording.codec import CellState, RobotState, Step
from armgate.world.states import Snapshot

Array = NDArray[np.float64]


@dataclass
class RobotSeries:
    """Series of one robot.

    Attributes:
        time: Virtual time of each tick, s.
        q: Measured positions at each tick, rad or m by joint.
        setpoint: Setpoints at each tick, rad or m by joint.
        verdicts: Verdicts of the gate on its commands, in order.
        last: Newest entry of the robot in the states; None before the first.
    """

    time: list[float] = field(default_factory=list)
    q: list[tuple[float, ...]] = field(default_factory=list)
    setpoint: list[tuple[float, ...]] = field(default_factory=list)
    verdicts: list[Verdict] = field(default_factory=list)
    last: m.Entry | None = None

    @property
    def betas(self) -> Array:
        """Admitted share β of each command (k,)."""
        return np.array([verdict.beta for verdict in self.verdicts], dtype=np.float64)

    def take(self, entry: m.Entry) -> None:
        """Add the entry of a tick."""
        self.last = entry
        if entry.q is not None and entry.setpoint is not None:
            self.time.append(entry.time)
            self.q.append(entry.q)
            self.setpoint.append(entry.setpoint)


@dataclass
class Series:
    """Series of one trial; a `RunRecorder` of a world.

    Attributes:
        robots: Series of the robots by name.
        signals: Times, s, and values of each signal, one for each instant at which it had a value.
        time: Virtual time of the last instant, s.
    """

    robots: dict[str, RobotSeries] = field(default_factory=dict)
    signals: dict[str, tuple[list[float], list[tuple[float, ...]]]] = field(default_factory=dict)
    time: float = 0.0

    @classmethod
    def of(cls, folder: Path, duration: float, robots: Collection[str]) -> "Series":
        """Return the series in a recording, up to a time or to the end of the last lease of some robots.

        Args:
            folder: Folder of the recording.
            duration: Longest duration, s.
            robots: Robots of the awaited participants; empty: only the duration counts.

        Raises:
            RecordingError: The recording cannot be read.
        """
        recording = Recording.open(folder)
        series = cls({robot.name: RobotSeries() for robot in recording.description.robots})
        held: dict[str, bool] = {}
        for _, item in recording.items():  # noqa: PERF102  (not a dictionary)
            if isinstance(item, Step):
                series.tap(item.event, item.outputs)
                if isinstance(item.event, LeaseChange):
                    held[item.event.robot] = item.event.fence is not None
            elif isinstance(item, RobotState):
                series.robots[item.entry.robot].take(item.entry)
            elif isinstance(item, CellState):
                series._instant(item.time, item.signals)
                if item.time >= duration or (robots and all(held.get(name) is False for name in robots)):
                    break
        return series

    def begin(self, cell: Cell, start: str, now: Callable[[], float], compiled: bool | None) -> None:
        """Begin the series of a world."""
        self.robots = {robot.name: RobotSeries() for robot in cell.robots}

    def tap(self, event: GateEvent, outputs: Sequence[GateOutput]) -> None:
        """Add the verdicts of a step of the gate."""
        for output in outputs:
            if isinstance(output, Verdict):
                self.robots[output.robot].verdicts.append(output)

    def show(self, snapshot: Snapshot) -> None:
        """Add the states of an instant."""
        ticked = {tick.robot for tick in snapshot.ticks}
        self._take(entry for entry in snapshot.entries if entry.robot in ticked)
        self._instant(max((tick.time for tick in snapshot.ticks), default=self.time), snapshot.signals)

    def _take(self, entries: Iterable[m.Entry]) -> None:
        for entry in entries:
            self.robots[entry.robot].take(entry)

    def _instant(self, time: float, signals: Mapping[str, m.SignalValue]) -> None:
        self.time = time
        for name, signal in signals.items():
            times, values = self.signals.setdefault(name, ([], []))
            times.append(time)
            values.append(signal.value)
