"""Time by the clock on the wall: robots tick whatever clients do, commands are judged as they come."""

from collections.abc import Callable

from armgate.daemon.core.core import Core
from armgate.daemon.core.peer import Peer
from armgate.emulator import Instant, Lateness, WallClock
from armgate.protocol import messages as m


class WallClockPace:
    """Makes the robots tick by the monotonic clock.

    Args:
        periods: The robots' periods, s, in the order of the configuration.
        on_instant: Called with each instant.
    """

    lockstep = False

    def __init__(self, periods: list[float], on_instant: Callable[[Instant], None]) -> None:
        self._clock = WallClock(periods, on_instant)
        self._core: Core

    @property
    def lateness(self) -> Lateness:
        """How late the ticks came."""
        return self._clock.lateness

    @property
    def failed(self) -> bool:
        """Whether the run is a failed one, though the daemon works; never by the wall clock."""
        return False

    def now(self) -> float:
        """Daemon time, s."""
        return self._clock.time

    def step_of(self, instant: Instant) -> int | None:
        """Number that states give to this instant: none by the wall clock."""
        return None

    def session_id(self, name: str, number: int) -> str:
        """Id of the session with this name and number of connection."""
        return f"s{number}"

    def start(self, core: Core) -> None:
        """Begin with the first instant."""
        self._core = core
        self._clock.start()

    def let_rest(self, judging: bool) -> None:
        """Go on until the robots rest: the clock does so anyway."""

    def close(self) -> None:
        """No further instant comes."""
        self._clock.close()

    def join(self, peer: Peer) -> None:
        """A session said hello."""
        self._core.join(peer)

    def handle(self, peer: Peer, message: m.Message) -> None:
        """A client said something: it counts at once."""
        self._core.handle(peer, message)

    def leave(self, peer: Peer) -> None:
        """A session is gone."""
        self._core.leave(peer)
