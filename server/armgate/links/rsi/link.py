"""The RSI link without sockets and clock: from the KRC's datagrams to replies and events.

Each telegram is a tick. The reply carries the setpoint after the increment that the plan has for this tick.
The tick is reported afterwards. `states` defines the reactions to lateness, loss and contradiction.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

from armgate.events import Joints, Plan, PlanAnswer, Rebase, Tick
from armgate.links.link import LinkEvent
from armgate.links.plan_player import PlanPlayer, Played
from armgate.links.rsi.diagnostics import Diagnostics
from armgate.links.rsi.ipoc_and_delay import Order, Succession, TelegramCounter
from armgate.links.rsi.program_run import NEW_RUN, Run
from armgate.links.rsi.setup import Address, Setup, warnings_of
from armgate.links.rsi.states import Event, LinkStates, State
from armgate.links.rsi.supervision import Supervisor
from armgate.links.rsi.telegram import Telegram, TelegramError, TelegramReader


@dataclass(frozen=True, slots=True)
class Response:
    """Response to a datagram: first the reply (None: no reply) is sent, then the events are reported."""

    reply: bytes | None = None
    events: tuple[LinkEvent, ...] = ()


_NOTHING = Response()


class RsiLink:
    """Link that plays the plan of one robot at the telegrams of its KRC; a `Link`.

    Args:
        setup: Robot and KRC.
        start: Start id that plans carry.
        note: Called with each note to the operator about what the KRC sends, once for each mistake.
    """

    def __init__(self, setup: Setup, start: str, note: Callable[[str], None] = lambda text: None) -> None:
        self._setup = setup
        self._player = PlanPlayer(setup.robot, start)
        self._diagnostics = Diagnostics(setup.robot, note)
        self._states = LinkStates(setup.robot)
        self._supervisor = Supervisor(setup, self._states, self._player, self._diagnostics)
        self._reader = TelegramReader(setup.axes, programmed=setup.programmed)
        self._run: Run | None = None

    # --- the daemon's side --------------------------------------------------------------------------------

    @property
    def robot(self) -> str:
        """Name of the robot."""
        return self._setup.robot

    @property
    def state(self) -> State:
        """State of the link."""
        return self._states.state

    @property
    def rejected(self) -> Counter[str]:
        """Number of rejected datagrams, by kind."""
        return self._diagnostics.rejected

    @property
    def remaining(self) -> int:
        """Number of increments left to play if no other plan comes; 0 at rest."""
        return self._player.remaining

    def offer(self, plan: Plan) -> PlanAnswer:
        """Replace the held plan by compare-and-swap; ``inactive`` unless the robot can be moved."""
        if not self._states.accepts_plans or self._run is None or self._run.rebased:
            return PlanAnswer(plan.robot, plan.key, False, "inactive")
        return self._player.offer(plan)

    def rebase(self, rebase: Rebase) -> None:
        """Drop the plan; re-arm a link that is lost or faulted.

        The setpoint of ``rebase`` is not used: the link's setpoint stays the position that the KRC holds, and
        the next tick reports it. The difference between setpoint and measured position does not move a robot
        at rest.
        """
        self._player.rebase(rebase)
        if self._run is not None:
            self._run.rebased = True
        if self._states.go(Event.REARMED):
            self._supervisor.synchronise(self._run)

    # --- the KRC's side -----------------------------------------------------------------------------------

    def datagram(self, data: bytes, source: Address, now: float) -> Response:
        """Handle a datagram.

        Args:
            data: Its bytes.
            source: Address and port that sent it.
            now: Time of its arrival, s.
        """
        if not self._from_krc(source, now):
            text = f"a datagram from {source[0]}:{source[1]}, which is not the KRC"
            self._diagnostics.reject("sender", text)
            return _NOTHING
        try:
            telegram = self._reader.read(data)
            if not telegram.short:
                return self._telegram(telegram, source, now)
            self._diagnostics.reject("short")
        except TelegramError as error:
            self._diagnostics.reject(error.kind, f"not a telegram of a KRC: {error}")
            if error.kind in ("element", "value"):
                self._states.fault(f"a telegram contradicts the configuration: {error}")
        return Response(None, self._states.report())

    def poll(self, now: float) -> tuple[LinkEvent, ...]:
        """Return the events that are due by now, such as the loss of the link."""
        deadline = self.next_deadline()
        if deadline is not None and now >= deadline:
            self._lose(f"no telegram for {self._setup.silence:g} s")
        return self._states.report()

    def next_deadline(self) -> float | None:
        """Return the time at which the link is lost if no telegram comes, s; None if it cannot be lost."""
        if self._run is None or not self._states.armed:
            return None
        return self._run.time + self._setup.silence

    # --- place of a telegram ------------------------------------------------------------------------------

    def _from_krc(self, source: Address, now: float) -> bool:
        if source[0] != self._setup.krc:
            return False
        run = self._run
        return run is None or source[:2] == run.source or now - run.time > NEW_RUN * self._setup.period

    def _telegram(self, telegram: Telegram, source: Address, now: float) -> Response:
        run = self._run
        if run is None or source[:2] != run.source:
            return self._begin(telegram, source, now)
        ipoc, delay = run.counter.ipoc, run.counter.delay
        paused = not self._states.armed and now - run.time > self._setup.silence
        succession = run.counter.place(telegram.ipoc, telegram.delay)
        if succession.order is Order.TWICE and telegram.delay > delay:
            return self._repeat(run, telegram, now)
        if succession.order is Order.TWICE or (succession.order is Order.OLD and not paused):
            self._diagnostics.reject(succession.order.value)
            return Response(None, self._states.report())
        continues = telegram.delay >= delay and run.continues(telegram, succession, paused, now)
        if continues is False:
            return self._begin(telegram, source, now)
        if succession.order is not Order.NEXT:
            self._states.fault(f"the IPOC jumped from {ipoc} to {telegram.ipoc}")
        if continues is None:
            self._supervisor.block_unknown(run)
        if succession.order is not Order.NEXT:
            return self._jumped(run, telegram, now)
        self._supervisor.check(run, telegram, succession, paused, now)
        return self._respond(run, telegram, now)

    def _begin(self, telegram: Telegram, source: Address, now: float) -> Response:
        """Begin a run after RSI_ON; the run is never answered if the robot is not at its reference."""
        if self._run is not None and self._states.accepts_plans:
            self._lose("the KRC's program began anew")
        run = self._run = Run.begun(self._setup, telegram, source, now)
        run.rebased = self._player.tick >= 0
        self._player.drop()
        self._states.go(Event.BEGUN)
        self._supervisor.synchronise(run)
        for warning in warnings_of(self._setup):
            self._diagnostics.note_once(warning)
        self._supervisor.check_start(run)
        return self._respond(run, telegram, now)

    def _repeat(self, run: Run, telegram: Telegram, now: float) -> Response:
        """Repeat the reply: the KRC got none, sent its telegram again, and has held the robot."""
        late = telegram.delay - run.counter.delay
        run.counter.delay, run.time = telegram.delay, now
        self._diagnostics.note_once(
            f"the KRC sent IPOC {telegram.ipoc} again, with Delay {telegram.delay}: the reply was lost, "
            "and is repeated"
        )
        self._supervisor.hold(run, late)
        objection = run.objection or run.too_late()
        if objection is not None:
            self._states.fault(objection)
        return Response(run.reply, self._states.report())

    def _jumped(self, run: Run, telegram: Telegram, now: float) -> Response:
        """Continue after a jump of the IPOC; the position that the KRC holds is known only at rest."""
        if not run.commanded.settle(Succession(Order.JUMP, missed=0, late=2), paused=True):
            self._supervisor.block_unknown(run)
        run.counter = TelegramCounter(telegram.ipoc, telegram.delay)
        self._supervisor.hold(run, 0)
        return self._respond(run, telegram, now)

    def _lose(self, reason: str) -> None:
        if self._states.lose(reason):
            self._player.drop()
            if self._run is not None:
                self._run.rebased = True

    # --- reply and tick -----------------------------------------------------------------------------------

    def _respond(self, run: Run, telegram: Telegram, now: float) -> Response:
        """Play the increment of this tick, write the reply, and report the tick."""
        played, moves = self._play(run)
        probed = None if run.proven else self._probed(run)
        commanded = run.commanded
        values = commanded.step(played.increment) if probed is None else commanded.go_to(probed)
        if run.adds:
            values = (0.0,) * len(values)
        run.reply = None if run.silent else self._setup.writer.write(values, telegram.ipoc)
        # The probe's motion is not an increment of a plan: the tick reports the new setpoint as a rebase.
        tick = self._tick(run, telegram, played, now, rebased=run.rebased or probed is not None)
        run.q, run.programmed, run.time = telegram.q, telegram.programmed, now
        run.rebased = False
        if moves:
            run.resting_since = now
        return Response(run.reply, self._states.report(tick))

    def _tick(self, run: Run, telegram: Telegram, played: Played, now: float, *, rebased: bool) -> Tick:
        return Tick(
            robot=self._setup.robot,
            tick=self._player.tick,
            time=now,
            q=telegram.q,
            setpoint=run.commanded.setpoint,
            increment=played.increment or (0.0,) * len(telegram.q),
            plan=played.key,
            index=played.index,
            rebased=rebased,
        )

    def _probed(self, run: Run) -> Joints | None:
        """Return the next position of the probe, None if it does not move.

        After an objection, this is a position on the way back to the reference.
        """
        commanded = run.commanded
        going = self._states.state is State.SYNCHRONISING and run.agreed and run.objection is None
        target = run.probe.target(commanded.reference, commanded.setpoint, going)
        return None if run.silent or target == commanded.setpoint else target

    def _play(self, run: Run) -> tuple[Played, bool]:
        if run.rebased:
            self._player.drop()
        played = self._player.play()
        moves = played.increment is not None and any(played.increment)
        self._states.go(Event.MOVES if moves else Event.RESTS)
        return played, moves
