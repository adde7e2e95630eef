"""Pace by lock-step: an event loop around `armgate.world.lockstep`, with a timer for silent participants."""

import asyncio
from collections.abc import Callable, Mapping, Sequence
from time import monotonic

from armgate.daemon.pace.pace import TickReceiver
from armgate.world.core import Core
from armgate.world.interfaces import EventLog
from armgate.world.lockstep import Lockstep


class LockstepPace:
    """`Pace` in which the robots tick when the participants are done.

    Attributes:
        steps: The lock-step, which handles the requests of sessions.

    Args:
        periods: Periods of the robots, s, in the order of the configuration.
        participants: Names of the clients that each step waits for.
        grace: Time for which a participant may send nothing while a step waits for it, s of the wall clock.
        log: Receives events.
        wall: The wall clock, used only for the grace, s.
    """

    lockstep = True

    def __init__(
        self,
        periods: Sequence[float],
        participants: Sequence[str],
        grace: float,
        log: EventLog,
        wall: Callable[[], float] = monotonic,
    ) -> None:
        self.steps = Lockstep(periods, participants, grace, log, wall)
        self._grace = grace
        self._watch: asyncio.TimerHandle | None = None
        self._closed = False

    @property
    def failed(self) -> bool:
        """True if a participant was dropped."""
        return self.steps.failed

    def now(self) -> float:
        """Return daemon time, s: virtual."""
        return self.steps.now()

    def session_id(self, name: str, number: int) -> str:
        """Return the id of a session; that of a participant does not depend on the order of connections."""
        return self.steps.session_id(name, number)

    async def open(self) -> None:
        """Do nothing: the robots are in this process."""

    def start(self, core: Core, receiver: TickReceiver) -> None:
        """Begin with the first instant; the next one waits for the participants."""
        self.steps.start(core, receiver.due)
        self._watch_later()

    def let_rest(self, decide: bool) -> None:
        """Continue without waiting for any participant, until `close`."""
        if self.steps.let_rest(decide):
            asyncio.get_running_loop().call_soon(self._run_on)

    def close(self) -> None:
        """End the pace: there is no further instant."""
        self._closed = True
        if self._watch is not None:
            self._watch.cancel()

    def warnings(self) -> Mapping[str, str]:
        """Return no warnings: in virtual time no tick is late."""
        return {}

    def figures(self) -> Mapping[str, float]:
        """Return no figures."""
        return {}

    def _run_on(self) -> None:
        if not self._closed:
            self.steps.advance()
            asyncio.get_running_loop().call_soon(self._run_on)

    def _watch_later(self) -> None:
        self._watch = asyncio.get_running_loop().call_later(self._grace / 4, self._check_grace)

    def _check_grace(self) -> None:
        if not self._closed:
            self.steps.drop_silent()
            self._watch_later()
