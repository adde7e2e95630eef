"""Recording as a source of states, with a position in time that advances during playback."""

from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from threading import Lock
from time import monotonic

from armgate.client import Description, State
from armgate.recording import DamagedError, Recording, RecordingError, StateSeries

STEP = 1.0 / 60.0
"""Shortest time between two look-ups of a state during playback, s."""


class Player:
    """Player of a recording; its methods may be called from any thread.

    Args:
        path: Folder of the recording, or one of its files.
        now: Monotonic clock, s.

    Attributes:
        description: Description of the cell.
        length: Length of the recording, s.

    Raises:
        RecordingError: It is not a recording, is truncated or damaged, has a later format, or holds no
            states.
    """

    description: Description

    def __init__(self, path: Path, now: Callable[[], float] = monotonic) -> None:
        self._recording = Recording.open(path)
        self._series = StateSeries(self._recording)
        if self._series.at(self._series.end) is None:
            raise DamagedError(path, "holds no states; expected those of a run")
        self.description = self._series.description
        self.length = self._series.end - self._series.start
        self._now, self._lock = now, Lock()
        self._at, self._since, self._speed, self._playing = 0.0, now(), 1.0, False
        self._shown: tuple[float, State | None] | None = None
        self._problem: str | None = None

    # --- the source of states -------------------------------------------------------------------------------

    def asset(self, name: str) -> bytes:
        """Return the asset with this SHA-256.

        Raises:
            DamagedError: The recording does not hold the asset, or holds other content under its name.
        """
        try:
            return self._recording.header.asset(name)
        except KeyError:
            text = f"does not hold {name[:12]}…, which its description names"
        except ValueError:
            text = f"holds other content as {name[:12]}…, which its description names"
        raise DamagedError(self._recording.path, text)

    def newest(self) -> State | None:
        """Return the state to show now."""
        with self._lock:
            time = self._time()
            if self._shown is None or not self._same(time, self._shown[0]):
                try:
                    self._shown = (time, self._series.at(self._series.start + time))
                except RecordingError as error:
                    self._problem = str(error)
            return None if self._shown is None else self._shown[1]

    @property
    def problem(self) -> str | None:
        """Reason why the recording cannot be read any further."""
        return self._problem

    def describe(self, _state: State) -> str:
        """Return the time of the recording, and the position in it, in words."""
        ns = self._recording.header.origin_ns + int(1e9 * (self._series.start + self.time))
        when = datetime.fromtimestamp(ns // 1_000_000_000, UTC).astimezone()
        return f"recorded {when:%Y-%m-%d %H:%M:%S}, {self.time:.1f} of {self.length:.1f} s"

    # --- playback -------------------------------------------------------------------------------------------

    @property
    def time(self) -> float:
        """Position that is shown, s from the beginning."""
        with self._lock:
            return self._time()

    @property
    def playing(self) -> bool:
        """Return True during playback; False at the end of the recording."""
        with self._lock:
            return self._playing and self._time() < self.length

    def play(self, playing: bool) -> None:
        """Start or pause playback; at the end it starts from the beginning."""
        with self._lock:
            time = self._time()
            self._go(0.0 if playing and time >= self.length else time)
            self._playing = playing

    def seek(self, time: float) -> None:
        """Move to a position, s from the beginning."""
        with self._lock:
            self._go(min(max(time, 0.0), self.length))

    def set_speed(self, speed: float) -> None:
        """Set the playback speed, in seconds of the recording per second."""
        with self._lock:
            self._go(self._time())
            self._speed = speed

    def _go(self, time: float) -> None:
        self._at, self._since = time, self._now()

    def _time(self) -> float:
        passed = self._speed * (self._now() - self._since) if self._playing else 0.0
        return min(self._at + passed, self.length)

    def _same(self, time: float, shown: float) -> bool:
        return time == shown or (self._playing and 0.0 < time - shown < STEP and time < self.length)
