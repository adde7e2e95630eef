"""The RSI link without sockets and clock: told what came from the KRC, it says what is answered.

Each telegram is a tick. The reply carries the setpoint after the increment that the plan has for this tick;
only then the tick is told. What follows from lateness, loss and contradiction stands in ``states``.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

from armgate.events import Joints, LinkChange, LinkState, Plan, PlanAnswer, Rebase, Tick
from armgate.links.link import LinkEvent
from armgate.links.plan_player import PlanPlayer, Played
from armgate.links.rsi.accumulation import AccumulationDetector
from armgate.links.rsi.diagnostics import Diagnostics
from armgate.links.rsi.ipoc_and_delay import Follows, Order, Sequence
from armgate.links.rsi.probe import Probe
from armgate.links.rsi.program_run import NEW_RUN, UNKNOWN, Run
from armgate.links.rsi.setpoint import SetpointTracker
from armgate.links.rsi.setup import Address, Setup, warnings_of
from armgate.links.rsi.states import ARMED, TAKING, Event, State, after
from armgate.links.rsi.synchronisation import Agreement
from armgate.links.rsi.telegram import Telegram, TelegramError, TelegramReader

_SETTLED = 1.0
"""A robot that rests for so long is where it was commanded to be, s."""
_ADDS = (
    "moves on beyond its setpoints, as if the KRC added corrections up (RSI_ON with #RELATIVE): it is "
    "answered by zeros; start its program anew"
)
_WHY = "does AXISCORR cut, has RECEIVE other tags, or was RSI_ON called with another mode than the cell's?"


@dataclass(frozen=True, slots=True)
class Answer:
    """What a datagram leads to: first the reply (None: none) goes out, then the events are told."""

    reply: bytes | None = None
    events: tuple[LinkEvent, ...] = ()


_NOTHING = Answer()


class RsiLink:
    """Holds the plan of one robot and plays it at the telegrams of its KRC; a ``Link``.

    Args:
        setup: Its robot and KRC.
        start: The daemon's start id.
        note: Told in plain words, once each, what is wrong with what comes in.
    """

    def __init__(self, setup: Setup, start: str, note: Callable[[str], None] = lambda text: None) -> None:
        self._setup = setup
        self._player = PlanPlayer(setup.robot, start)
        self._remarks = Diagnostics(setup.robot, note)
        self._state = State.WAITING
        self._run: Run | None = None
        self._agreement = Agreement(setup)
        self._reader = TelegramReader(setup.axes, programmed=setup.programmed)
        self._rebased = False
        self._rest_since = 0.0
        self._events: list[LinkEvent] = []

    # --- the daemon's side --------------------------------------------------------------------------------

    @property
    def robot(self) -> str:
        """The robot's name."""
        return self._setup.robot

    @property
    def state(self) -> State:
        """What it does."""
        return self._state

    @property
    def refused(self) -> Counter[str]:
        """How many datagrams were refused, by kind."""
        return self._remarks.refused

    @property
    def remaining(self) -> int:
        """How many increments are still to be played if nothing else comes; 0 at rest."""
        return self._player.remaining

    def offer(self, plan: Plan) -> PlanAnswer:
        """Replace the held plan by compare-and-swap; ``inactive`` unless the robot can be moved."""
        if self._state not in TAKING or self._rebased:
            return PlanAnswer(plan.robot, plan.key, False, "inactive")
        return self._player.offer(plan)

    def rebase(self, rebase: Rebase) -> None:
        """Drop the plan; a link that is lost or has faulted is re-armed.

        The setpoint stays what the KRC holds, which the next tick tells: a robot at rest is not moved by the
        difference between commanded and measured position.
        """
        self._player.rebase(rebase.resets)
        self._rebased = True
        if self._go(Event.REARMED):
            self._synchronise(self._run)

    # --- the KRC's side -----------------------------------------------------------------------------------

    def datagram(self, data: bytes, source: Address, now: float) -> Answer:
        """A datagram came.

        Args:
            data: Its bytes.
            source: From where, address and port.
            now: Time of its arrival, s.
        """
        if not self._familiar(source, now):
            self._remarks.refuse("stranger", f"a datagram from {source[0]}:{source[1]}, which is not the KRC")
            return _NOTHING
        try:
            telegram = self._reader.read(data)
            if not telegram.short:
                return self._telegram(telegram, source, now)
            self._remarks.refuse("short")
        except TelegramError as error:
            self._remarks.refuse(error.kind, f"not a telegram of a KRC: {error}")
            if error.kind in ("element", "value"):
                self._contradict(f"a telegram contradicts the configuration: {error}")
        return Answer(None, self._told())

    def poll(self, now: float) -> tuple[LinkEvent, ...]:
        """Time has passed: the link may be lost."""
        deadline = self.next_deadline()
        if deadline is not None and now >= deadline:
            self._lose(f"no telegram for {self._setup.silence:g} s")
        return self._told()

    def next_deadline(self) -> float | None:
        """When it is lost if nothing comes, s; None: it has nothing to lose."""
        if self._run is None or self._state not in ARMED:
            return None
        return self._run.time + self._setup.silence

    # --- who speaks ---------------------------------------------------------------------------------------

    def _familiar(self, source: Address, now: float) -> bool:
        if source[0] != self._setup.krc:
            return False
        run = self._run
        return run is None or source[:2] == run.source or now - run.time > NEW_RUN * self._setup.period

    def _telegram(self, telegram: Telegram, source: Address, now: float) -> Answer:
        run = self._run
        if run is None or source[:2] != run.source:
            return self._begin(telegram, source, now)
        ipoc, delay = run.sequence.ipoc, run.sequence.delay
        paused = self._state not in ARMED and now - run.time > self._setup.silence
        follows = run.sequence.place(telegram.ipoc, telegram.delay)
        if follows.order is Order.TWICE and telegram.delay > delay:
            return self._again(run, telegram, now)
        if follows.order is Order.TWICE or (follows.order is Order.OLD and not paused):
            self._remarks.refuse(follows.order.value)
            return Answer(None, self._told())
        continues = telegram.delay >= delay and run.continues(telegram, follows, paused, now)
        if continues is False:
            return self._begin(telegram, source, now)
        if follows.order is not Order.NEXT:
            self._contradict(f"the IPOC jumped from {ipoc} to {telegram.ipoc}")
        if continues is None:
            self._object(run, UNKNOWN, silent=not self._setup.relative)
        if follows.order is not Order.NEXT:
            return self._jumped(run, telegram, now)
        return self._next(run, telegram, follows, paused, now)

    def _again(self, run: Run, telegram: Telegram, now: float) -> Answer:
        """The KRC sends a telegram again because no reply came: repeat the reply. It has held the robot."""
        late = telegram.delay - run.sequence.delay
        run.sequence.delay, run.time = telegram.delay, now
        self._remarks.hint(
            f"the KRC sent IPOC {telegram.ipoc} again, Delay {telegram.delay}: repeat the reply, it was lost"
        )
        self._held(run, late)
        objection = run.objection or run.too_late()
        if objection is not None:
            self._contradict(objection)
        return Answer(run.reply, self._told())

    def _begin(self, telegram: Telegram, source: Address, now: float) -> Answer:
        """RSI_ON: the corrections count from the programmed position, where the robot has to be."""
        if self._run is not None and self._state in TAKING:
            self._lose("the KRC's program began anew")
        sequence = Sequence(telegram.ipoc, telegram.delay)
        reference = telegram.programmed if self._setup.programmed else telegram.q
        commanded = SetpointTracker(self._setup.axes, reference, self._setup.relative)
        runaway = AccumulationDetector(self._setup.tolerance, self._setup.speed, self._setup.period)
        run = Run(
            self._setup, source[:2], sequence, commanded, telegram.q, telegram.programmed, now,
            Probe(self._setup), runaway,
        )  # fmt: skip
        self._run, self._rebased = run, self._player.tick >= 0
        self._player.drop()
        self._go(Event.HEARD)
        self._synchronise(run)
        for warning in warnings_of(self._setup):
            self._remarks.hint(warning)
        misplaced = self._agreement.misplaced(reference, telegram.q)
        if misplaced is not None:
            self._object(run, misplaced, silent=True)
        return self._answer(run, telegram, now)

    def _synchronise(self, run: Run | None) -> None:
        """Begin to gather evidence; what was proven of a run's mode stays proven."""
        self._agreement.begin()
        if run is not None:
            run.agreed = False
            run.probe.begin()

    # --- a telegram of the run ----------------------------------------------------------------------------

    def _next(self, run: Run, telegram: Telegram, follows: Follows, paused: bool, now: float) -> Answer:
        disturbed = bool(follows.late or follows.missed)
        # An unproven absolute KRC holds one of two corrections of the probe: both are below the tolerance.
        known = run.commanded.settle(follows, paused) or not (run.proven or self._setup.relative)
        if disturbed or paused:
            self._held(run, max(follows.late, follows.missed))
        else:
            run.row = 0
        run.accepted |= follows.late == 0
        if not known:
            self._object(run, UNKNOWN, silent=not self._setup.relative)
        objection = (
            run.objection
            or run.jumped(telegram.q, follows.missed + 1)
            or (run.too_late() if disturbed else None)
        )
        if objection is not None:
            self._contradict(objection)
        self._agree(run, telegram, follows, now)
        if run.proven and not self._setup.relative and not run.adds:
            self._watch(run, telegram, follows.missed + 1)
        return self._answer(run, telegram, now)

    def _jumped(self, run: Run, telegram: Telegram, now: float) -> Answer:
        """The numbers go on from elsewhere. What the KRC holds is only known if the robot rested."""
        if not run.commanded.settle(Follows(Order.JUMP, missed=0, late=2), paused=True):
            self._object(run, UNKNOWN, silent=not self._setup.relative)
        run.sequence = Sequence(telegram.ipoc, telegram.delay)
        self._held(run, 0)
        return self._answer(run, telegram, now)

    def _held(self, run: Run, cycles: int) -> None:
        """The KRC has held the robot: it starts again from rest, and never catches up."""
        run.row += cycles
        self._player.drop()
        self._rebased = True
        self._go(Event.HELD)

    def _agree(self, run: Run, telegram: Telegram, follows: Follows, now: float) -> None:
        """Judge whether all agrees while synchronising, and whether a resting robot is where it should be."""
        if self._state is State.SYNCHRONISING:
            verdict = self._evidence(run, telegram, follows, now)
            if verdict == "":
                run.sequence.learning = False
                run.proven = True
                self._rest_since = now
                self._ready()
            elif verdict is not None and run.agreed:
                self._object(run, verdict)
            elif verdict is not None:
                self._contradict(verdict)
        elif self._state is State.READY and now - self._rest_since > _SETTLED:
            astray = self._agreement.astray(run.commanded.setpoint, telegram.q)
            if astray is not None:
                # What the KRC makes of replies is not what is meant by them: no further one can be right.
                self._object(run, f"{astray}: {_WHY}")

    def _evidence(self, run: Run, telegram: Telegram, follows: Follows, now: float) -> str | None:
        """Return "" if telegrams agree and the probe proves the mode, else a text, None while it is open."""
        clean = not (follows.late or follows.missed)
        verdict = None
        if not run.agreed:
            clean = not self._anchored(run, telegram.q) and clean
            verdict = self._agreement.take(run.commanded, telegram.q, clean, now)
            run.agreed = verdict == ""
        if run.agreed and not run.proven:
            verdict = run.probe.take(telegram.q, run.commanded.offset, follows, now)
        for hint in self._agreement.hints(telegram, verdict is not None):
            self._remarks.hint(hint)
        return verdict

    def _anchored(self, run: Run, q: Joints) -> bool:
        """Let corrections count from a measured position, as long as none was sent; True if it moves."""
        if self._setup.programmed or run.proven or not run.probe.moved(run.commanded.reference, q):
            return False
        run.commanded = SetpointTracker(self._setup.axes, q, self._setup.relative)
        self._rebased = True
        return True

    def _watch(self, run: Run, telegram: Telegram, cycles: int) -> None:
        """Find out whether the robot runs away under its held total, which zeros stop then."""
        commanded = run.commanded
        number = run.runaway.take(telegram.q, commanded.setpoint, commanded.reference, cycles)
        if number is not None:
            run.adds = self._rebased = True
            self._player.drop()
            self._object(run, f"{self._setup.axes[number].name} {_ADDS}")

    def _object(self, run: Run, reason: str, *, silent: bool = False) -> None:
        """Nothing moves any more in this run; if ``silent``, no reply is known to hold the robot either."""
        run.objection, run.silent = reason, run.silent or silent
        self._remarks.tell(reason) if self._state not in ARMED else self._contradict(reason)

    def _answer(self, run: Run, telegram: Telegram, now: float) -> Answer:
        """Play what this tick is due, answer, and tell."""
        played, moves = self._play()
        probed = None if run.proven else self._probed(run)
        commanded = run.commanded
        values = commanded.step(played.increment) if probed is None else commanded.lead(probed)
        if run.adds:
            values = (0.0,) * len(values)
        run.reply = None if run.silent else self._setup.writer.write(values, telegram.ipoc)
        tick = Tick(
            robot=self._setup.robot,
            tick=self._player.tick,
            time=now,
            q=telegram.q,
            setpoint=run.commanded.setpoint,
            increment=played.increment or (0.0,) * len(telegram.q),
            plan=played.key,
            index=played.index,
            # What the probe commands is no increment of a plan: the robot is held elsewhere.
            rebased=self._rebased or probed is not None,
        )
        run.q, run.programmed, run.time = telegram.q, telegram.programmed, now
        self._rebased = False
        if moves:
            self._rest_since = now
        return Answer(run.reply, self._told(tick))

    def _probed(self, run: Run) -> Joints | None:
        """Return where the probe leads, None if it stays; refuted or disturbed, it leads back."""
        commanded = run.commanded
        going = self._state is State.SYNCHRONISING and run.agreed and run.objection is None
        target = run.probe.target(commanded.reference, commanded.setpoint, going)
        return None if run.silent or target == commanded.setpoint else target

    def _play(self) -> tuple[Played, bool]:
        if self._rebased:
            self._player.drop()
        played = self._player.play()
        moves = played.increment is not None and any(played.increment)
        self._go(Event.MOVES if moves else Event.RESTS)
        return played, moves

    # --- states -------------------------------------------------------------------------------------------

    def _go(self, event: Event) -> bool:
        state = after(self._state, event)
        if state is None:
            return False
        self._state = state
        return True

    def _ready(self) -> None:
        if self._go(Event.AGREED):
            self._events.append(LinkChange(self._setup.robot, LinkState.READY))

    def _lose(self, reason: str) -> None:
        if self._go(Event.GONE):
            self._player.drop()
            self._rebased = True
            self._events.append(LinkChange(self._setup.robot, LinkState.LOST, reason))

    def _contradict(self, reason: str) -> None:
        """No new plan is taken; what is left of the held one ends at rest, and is played."""
        if self._go(Event.CONTRADICTED):
            self._events.append(LinkChange(self._setup.robot, LinkState.FAULTED, reason))

    def _told(self, tick: Tick | None = None) -> tuple[LinkEvent, ...]:
        """What has happened, a loss before the tick and readiness after it."""
        before = [event for event in self._events if _bad(event)]
        later = [event for event in self._events if not _bad(event)]
        self._events.clear()
        return (*before, *(() if tick is None else (tick,)), *later)


def _bad(event: LinkEvent) -> bool:
    return isinstance(event, LinkChange) and event.state is not LinkState.READY
