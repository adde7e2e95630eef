"""Pace by the wall clock: robots tick independently of clients; commands are decided as they arrive."""

from collections.abc import Mapping

from armgate.daemon.pace.pace import TickReceiver
from armgate.emulator import Instant, WallClock
from armgate.world.core import Core


class WallClockPace:
    """`Pace` by the monotonic clock, for the robots of this process.

    Args:
        periods: Periods of the robots, s, in the order of the configuration.
    """

    lockstep = False
    failed = False

    def __init__(self, periods: list[float]) -> None:
        self._clock = WallClock(periods, self._tick)
        self._receiver: TickReceiver

    def now(self) -> float:
        """Return daemon time, s."""
        return self._clock.time

    def session_id(self, name: str, number: int) -> str:
        """Return the id of a session: the number of its connection."""
        return f"s{number}"

    async def open(self) -> None:
        """Do nothing: the robots are in this process."""

    def start(self, core: Core, receiver: TickReceiver) -> None:
        """Begin with the first instant."""
        self._receiver = receiver
        core.start()
        self._clock.start()

    def let_rest(self, decide: bool) -> None:
        """Do nothing: the clock waits for no client."""

    def close(self) -> None:
        """End the pace: there is no further instant."""
        self._clock.close()

    def warnings(self) -> Mapping[str, str]:
        """Return a warning if ticks were processed later than the next one was due."""
        overruns = self._clock.lateness.overruns
        return {"late": f"{overruns} ticks came later than the next one was due"} if overruns else {}

    def figures(self) -> Mapping[str, float]:
        """Return the lateness of the ticks."""
        late = self._clock.lateness
        return {"ticks": late.count, "worst": late.worst, "half": late.half, "overruns": late.overruns}

    def _tick(self, instant: Instant) -> None:
        self._receiver.due(instant.time, instant.due, None)
