"""Ticks of the robots while the daemon runs, ends, or has failed."""

from collections.abc import Callable, Sequence
from typing import assert_never

from armgate.daemon.lifecycle.phase import Lifetime, Phase
from armgate.daemon.pace.pace import Pace
from armgate.daemon.recording.supervision import Recording
from armgate.events import LinkChange, PlanAnswer, Tick
from armgate.links.link import SteppedLink
from armgate.links.log import Log
from armgate.world.core import Core

_SETTLE = 5.0
"""Time after the end of its plan within which a robot must be measured at rest, s of daemon time."""


class Ticking:
    """`TickReceiver` of the daemon, which passes ticks from the pace to the core.

    Args:
        core: Processes the ticks.
        pace: Makes time pass.
        links: Links of the robots in this process, in the order of the configuration.
        recording: Recording, checked at every tick.
        life: The daemon's phase.
        log: Receives the end of motion.
        late: Called with the lateness of every tick, s; None: it is not measured.
        rested: Called once all robots rest or their time has passed, with True if the run is a success.
        failed: Called with an exception raised while an event is processed.
    """

    def __init__(
        self,
        core: Core,
        pace: Pace,
        links: Sequence[SteppedLink],
        recording: Recording,
        life: Lifetime,
        log: Log,
        *,
        late: Callable[[float], None] | None,
        rested: Callable[[bool], None],
        failed: Callable[[BaseException], None],
    ) -> None:
        self._core = core
        self._pace = pace
        self._links = tuple(links)
        self._recording = recording
        self._life = life
        self._log = log
        self._late = None if pace.lockstep else late
        self._rested = rested
        self._failed = failed
        self._rest_by = 0.0

    def come_to_rest(self) -> None:
        """Expect all robots to come to rest within the time that their plans need."""
        self._rest_by = self._pace.now() + self._core.time_left + _SETTLE

    def due(self, time: float, robots: Sequence[int], step: int | None) -> None:
        """Make robots of this process tick."""
        phase = self._life.phase
        match phase:
            case Phase.OVER:
                return
            case Phase.FAILED:
                self._core.note(self._advance(time, robots))
            case Phase.RUNNING | Phase.RESTING:
                self._prepare(time)
                self._core.tick(self._advance(time, robots), step)
            case _:
                assert_never(phase)
        if self._life.phase is not Phase.RUNNING:
            self._check_rest(time)

    def received(self, event: Tick | LinkChange | PlanAnswer) -> None:
        """Process an event of a robot in the robot server."""
        phase = self._life.phase
        match phase:
            case Phase.OVER:
                return
            case Phase.FAILED:
                if isinstance(event, Tick):
                    self._core.note([event])
            case Phase.RUNNING | Phase.RESTING:
                self._process(event)
            case _:
                assert_never(phase)
        if self._life.phase is not Phase.RUNNING and isinstance(event, Tick):
            self._check_rest(event.time)

    def idle(self, time: float) -> None:
        """Expire leases, or end the wait for rest, even if no robot ticks."""
        if self._life.phase is Phase.RUNNING:
            self._core.expire()
        elif self._life.phase is not Phase.OVER and time > self._rest_by:
            self._check_rest(time)

    def _advance(self, time: float, robots: Sequence[int]) -> list[Tick]:
        return [self._links[index].advance(time) for index in robots]

    def _process(self, event: Tick | LinkChange | PlanAnswer) -> None:
        try:
            if isinstance(event, Tick):
                self._prepare(event.time)
                self._core.tick([event])
            else:
                self._recording.check(self._core, self._life.phase is Phase.RUNNING)
                self._core.receive(event)
        except Exception as error:
            self._failed(error)

    def _prepare(self, due: float) -> None:
        for about, text in self._pace.warnings().items():
            self._core.warn(about, text)
        self._recording.check(self._core, self._life.phase is Phase.RUNNING)
        if self._late is not None:
            self._late(max(0.0, self._pace.now() - due))

    def _check_rest(self, time: float) -> None:
        if self._core.at_rest:
            self._log.info("at_rest", at=time)
            self._rested(True)
        elif time > self._rest_by:
            self._log.error("not_at_rest", at=time)
            self._rested(False)
