"""Observation of a run: the newest state, and the series for metrics and plots."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from armgate.client import Entry, State
from armgate.recording import Recording, RecordingError, StateSeries

COLUMNS = (
    "time_s", "angle_error_rad", "distance_error_m", "distance_m", "focus_x_m", "focus_y_m", "focus_z_m",
    "clearance_m", "repulsion", "progress", "emergency", "near_limit", "gate_follower", "gate_others",
    "leader_x_m", "leader_y_m", "leader_z_m",
)  # fmt: skip
NAN = float("nan")
_NOWHERE = (NAN, NAN, NAN)
_SEVERITY = {"admitted": 0.0, "limited": 1.0, "refused": 2.0}
_NUMBER = re.compile(r"\d+(\.\d+)?")


@dataclass
class Observation:
    """Observation of a run, from the state messages alone.

    The gate's columns hold the worst outcome since the last row: 0 admitted, 1 limited, 2 refused. A row of
    the series is one tick of the follower's robot. Smallest clearances and counts are running totals of the
    daemon: they are complete even if this observer was too slow to receive every state.

    Attributes:
        follower: Robot with the camera.
        until_released: True to end the observation when the follower's robot is released. The further states
            of a run depend on the speed of its processes, even in lock-step.
        state: Newest state.
        rows: Series, one tuple of ``COLUMNS`` per tick of the follower's robot.
        positions: Measured positions of the follower's robot, one per row, rad or m.
        first_time: Daemon time of the first state, s.
        nearest: Smallest observed distance between bodies of different owners, and the two bodies.
        missed: Number of ticks that this observer did not receive, by robot.
    """

    follower: str
    until_released: bool = False
    state: State | None = None
    rows: list[tuple[float, ...]] = field(default_factory=list)
    positions: list[tuple[float, ...]] = field(default_factory=list)
    first_time: float = 0.0
    nearest: tuple[float, tuple[str, str]] | None = None
    missed: dict[str, int] = field(default_factory=dict)
    _held: bool = False
    _warnings: dict[str, str] = field(default_factory=dict)
    _ticks: dict[str, int] = field(default_factory=dict)
    _signals: dict[str, tuple[float, ...]] = field(default_factory=dict)
    _counts: dict[str, Mapping[str, int]] = field(default_factory=dict)

    def take(self, state: State) -> None:
        """Add a state."""
        if self._over(state):
            return
        if self.state is None:
            self.first_time = state.time
        self._count(state)
        self._signals.update((name, signal.value) for name, signal in state.signals.items())
        self.state = state
        self._warnings.update((_NUMBER.sub("#", text), text) for text in state.warnings)
        now = self._nearest_now(state)
        if now is not None and (self.nearest is None or now < self.nearest):
            self.nearest = now
        if state.robot == self.follower:
            self.positions.extend(entry.q or () for entry in state.entries if entry.robot == self.follower)
            self.rows.append(self._row(state, NAN if now is None else now[0]))

    @property
    def warnings(self) -> list[str]:
        """The newest text of each kind of warning; texts that differ only in numbers are one kind."""
        return list(self._warnings.values())

    @property
    def missing(self) -> int:
        """Number of missing states of all robots."""
        return sum(self.missed.values())

    @property
    def elapsed(self) -> float:
        """Daemon time from the first state to the newest, s."""
        return 0.0 if self.state is None else self.state.time - self.first_time

    @property
    def entries(self) -> tuple[Entry, ...]:
        """Newest entry of every robot."""
        return () if self.state is None else self.state.entries

    @property
    def ticks(self) -> dict[str, int]:
        """Newest tick of every robot."""
        return {entry.robot: entry.tick for entry in self.entries}

    @property
    def least_clearance(self) -> float | None:
        """Smallest clearance to other robots and surroundings since the daemon's start, m."""
        found = [entry.least_clearance for entry in self.entries if entry.least_clearance is not None]
        return min(found, default=None)

    @property
    def late_commands(self) -> int:
        """Number of commands that were admitted but arrived too late to be played."""
        return sum(entry.late_commands or 0 for entry in self.entries)

    def signal(self, name: str) -> tuple[float, ...] | None:
        """Return the newest value of a signal; None before the first. It remains after its owner has left."""
        return self._signals.get(name)

    def scalar(self, name: str) -> float | None:
        """Return the newest value of a scalar signal."""
        value = self.signal(name)
        return None if value is None else value[0]

    def _over(self, state: State) -> bool:
        """Return True if the observation has ended at this state."""
        held = any(entry.holder is not None for entry in state.entries if entry.robot == self.follower)
        self._held = self._held or held
        return self.until_released and self._held and not held

    def _count(self, state: State) -> None:
        before = self._ticks.get(state.robot)
        if before is not None and state.tick > before + 1:
            self.missed[state.robot] = self.missed.get(state.robot, 0) + state.tick - before - 1
        self._ticks[state.robot] = state.tick

    def _row(self, state: State, clearance: float) -> tuple[float, ...]:
        def value(name: str) -> float:
            found = state.signals.get(name)
            return NAN if found is None else found.value[0]

        place = _point(state, "follow.focus") or _NOWHERE
        leader = _point(state, "follow.leader") or place
        return (
            state.time - self.first_time, value("follow.angle_error"), value("follow.distance_error"),
            value("follow.distance"), *place, clearance, value("follow.repulsion"), value("lead.progress"),
            value("follow.emergency"), value("follow.near_limit"), *self._gate(state), *leader,
        )  # fmt: skip

    def _gate(self, state: State) -> tuple[float, float]:
        """Return the worst outcome since the last row, of the follower's commands and of the others'."""
        worst = [0.0, 0.0]
        for entry in state.entries:
            who = int(entry.robot != self.follower)
            before = self._counts.get(entry.robot, {})
            self._counts[entry.robot] = counts = entry.counts or {}
            for key, number in counts.items():
                if number > before.get(key, 0):
                    worst[who] = max(worst[who], _SEVERITY.get(key.partition(":")[0], 0.0))
        return worst[0], worst[1]

    @staticmethod
    def _nearest_now(state: State) -> tuple[float, tuple[str, str]] | None:
        found = [
            (near.distance, near.pair)
            for entry in state.entries
            for near in entry.nearest or ()
            if not same_robot(near.pair)
        ]
        return min(found, default=None)


def completed(seen: Observation, recording: Path, lockstep: bool) -> Observation:
    """Return the observation from a recording, unless it lacks more states than the observer missed.

    A slow observer receives the newest state, never a backlog. A recording has every state, with clearances
    rounded down to a micrometre. In lock-step two runs must agree bit by bit, so the recording is always
    used.

    Args:
        seen: Observation of the running cell.
        recording: Folder of the finished recording.
        lockstep: True if the run was in lock-step; otherwise the recording is read only if states were
            missed.
    """
    if not (lockstep or seen.missed):
        return seen
    found = Observation(seen.follower, seen.until_released)
    try:
        for state in StateSeries(Recording.open(recording)).all(seen.follower):
            if lockstep or state.time >= seen.first_time:
                found.take(state)
    except RecordingError:
        return seen
    return found if found.rows and found.missing <= seen.missing else seen


def same_robot(pair: tuple[str, str]) -> bool:
    """Return True if both bodies belong to one robot (``FR/link_2``, ``FR/link_5``)."""
    a, b = (name.partition("/") for name in pair)
    return bool(a[1]) and a[0] == b[0] and bool(b[1])


def _point(state: State, name: str) -> tuple[float, ...] | None:
    """Return the value of a signal that is a point; None if it is missing or has another length."""
    found = state.signals.get(name)
    return None if found is None or len(found.value) != len(_NOWHERE) else found.value
