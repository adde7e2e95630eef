"""The virtual KRC without time and sockets: told what came in a cycle, it says what is sent.

At the beginning of a cycle the KRC looks for the reply to its last telegram, corrects the setpoint, hands it
to the drives, and sends the next telegram with the position measured at that moment. So what a reply commands
shows in the telegram after the next one at the earliest.
"""

from collections.abc import Iterable, Sequence
from random import Random

from armgate.emulator.krc.arm import Arm
from armgate.emulator.krc.context import Context
from armgate.emulator.krc.errors import KrcError
from armgate.emulator.krc.ethernet import E_AXES, Ethernet
from armgate.emulator.krc.feedback import Feedback
from armgate.emulator.krc.inbox import Arrival, Inbox
from armgate.emulator.krc.ipoc import Ipoc
from armgate.emulator.krc.machine import ACTIVE, Event, State, after
from armgate.emulator.krc.notes import Notes
from armgate.emulator.krc.profile import Profile
from armgate.emulator.krc.reply import Reply, ReplyParser
from armgate.emulator.krc.run import Run
from armgate.emulator.krc.telegram import TelegramWriter
from armgate.emulator.robot import EmulatedRobot

PENDANT = (Event.START, Event.STOP, Event.PAUSE, Event.RESUME, Event.ESTOP, Event.RESET, Event.RESTART)
"""What whoever stands at the pendant can do."""


class Controller:
    """One virtual KRC; it begins stopped.

    Args:
        profile: Which controller.
        context: Its RSI context.
        ethernet: Its RSI Ethernet file.
        arm: Its robot.
        chance: Where its IPOC begins, unless ``ipoc`` says it.
        notes: Its log.
        ipoc: The first IPOC; None: any.

    Raises:
        KrcError: The file corrects axes that the robot does not have, on a controller that minds.
    """

    def __init__(
        self,
        profile: Profile,
        context: Context,
        ethernet: Ethernet,
        arm: Arm,
        *,
        chance: Random,
        notes: Notes,
        ipoc: int | None = None,
    ) -> None:
        self._profile, self._context, self._ethernet, self._arm = profile, context, ethernet, arm
        self._chance, self._notes = chance, notes
        self._refuse_absent_axes()
        self._writer = TelegramWriter(ethernet, context.precision, profile.root)
        self._feedback = Feedback(arm, profile.linear_sent, self._writer.needed, moves=context.aspos_moves)
        self._inbox = Inbox(ReplyParser(ethernet), profile.reply_within, notes)
        self._robot = self._robot_at(arm.start)
        self._state, self._message, self._cycles, self._runs = State.STOPPED, "", 0, 0
        # Whether a reply is due; the run's first telegram is still to come; the last one was a short frame.
        self._asked, self._begins, self._short = False, True, False
        self._ipoc = self._first_ipoc(ipoc)
        self._run = self._begin()

    # --- from outside -------------------------------------------------------------------------------------

    @property
    def state(self) -> State:
        """What it does."""
        return self._state

    def cycle(self, arrivals: Iterable[Arrival]) -> bytes | None:
        """A cycle passes, in which ``arrivals`` came; the telegram that begins the next one, if one does."""
        self._cycles += 1
        self._robot.step(self._run.drives.setpoint)
        if self._asked and not self._ethernet.only_send:
            self._take(self._inbox.judge(arrivals, self._ipoc))
        self._asked = self._state in ACTIVE
        if self._asked:
            return self._telegram()
        if self._profile.ipoc_runs:
            self._ipoc.advance()
        return None

    def operate(self, event: Event) -> str | None:
        """Somebody at the pendant does something; why it has no effect, if it has none."""
        if after(self._state, event) is None:
            usual = ", ".join(one.value for one in PENDANT if after(self._state, one) is not None)
            return f"{event.value} has no effect while {self._state.value}; possible: {usual}"
        if event is Event.RESTART:
            self._ipoc = self._first_ipoc(None)
        if event in (Event.START, Event.RESTART):
            self._run = self._begin()
            self._runs += 1
        # Whatever it is, the robot stands still first, and no answer to an earlier telegram counts any more.
        self._run.drives.rest(self._run.drives.setpoint)
        self._asked = False
        self._go(event, f"{event.value} at the pendant")
        return None

    def jump_ipoc(self, value: int) -> None:
        """The next telegram carries this number."""
        self._ipoc.jump(value)

    def jog(self, axis: str, by: float) -> str | None:
        """Somebody moves an axis by hand, deg or mm; why not, if not."""
        if self._state in ACTIVE:
            return f"no jogging while {self._state.value}; stop or pause the program first"
        if axis not in self._arm.names:
            return f"there is no axis {axis!r}; expected one of {', '.join(self._arm.names)}"
        moved = list(self._robot.q)
        moved[self._arm.names.index(axis)] += by
        self._robot = self._robot_at(moved)
        self._run.drives.rest(moved)
        return None

    def status(self) -> dict[str, object]:
        """What there is to know, for people and tests; axes in deg and mm."""
        run, names = self._run, self._arm.names
        return {
            "state": self._state.value,
            "message": self._message,
            "cycles": self._cycles,
            "runs": self._runs,
            "ipoc": self._ipoc.last,
            "delay": run.lateness.count,
            "programmed": dict(zip(names, run.programmed, strict=True)),
            "setpoint": dict(zip(names, run.drives.setpoint, strict=True)),
            "measured": dict(zip(names, self._robot.q, strict=True)),
            "rejected": {fault.value: count for fault, count in sorted(self._inbox.rejected.items())},
        }

    # --- a cycle ------------------------------------------------------------------------------------------

    def _take(self, reply: Reply | None) -> None:
        """What a reply does, or that there was none in time."""
        missing = self._run.receive(None if reply is None else reply.values)
        if reply is not None:
            self._go(Event.ANSWERED, "the PC answers")
            self._note_contents(reply, missing)
        late = reply is None and not self._short
        self._short = False
        trouble = self._run.late(late) or self._run.move()
        if trouble is not None:
            event, text = trouble
            self._run.drives.rest(self._run.drives.setpoint)
            self._go(event, text)
        elif late:
            count = self._run.lateness.count
            self._notes.often("late", count, f"no valid reply to IPOC {self._ipoc.last} in time: HOLDON")

    def _note_contents(self, reply: Reply, missing: tuple[str, ...]) -> None:
        if missing:
            lacks = ", ".join(missing)
            self._notes.once("missing", f"the reply lacks {lacks}, which RECEIVE declares: HOLDON")
            self._notes.once(
                "zero", f"{lacks}: 0 until it comes (an override of 0 %, if it is connected to one)"
            )
        if reply.unknown:
            carries, known = ", ".join(reply.unknown), ", ".join(one.name for one in self._ethernet.received)
            self._notes.once("unknown", f"the reply carries {carries}: ignored; RECEIVE declares {known}")
        cartesian = self._run.registers.cartesian()
        if cartesian:
            self._notes.once(
                "cartesian",
                f"the reply corrects {', '.join(cartesian)}: this virtual KRC has no Cartesian corrections, "
                f"and nothing moves; correct axes, as AK.A1",
            )
        text = self._run.registers.named("EStr")
        if text:
            self._notes.once("estr", f"message from the PC: {text}")

    def _telegram(self) -> bytes:
        ipoc = self._ipoc.send()
        if self._begins and self._profile.short_first:
            self._begins, self._short = False, True
            return self._writer.short(ipoc)
        return self._writer.write(self._feedback.values(self._run, self._robot.q), ipoc)

    # --- states -------------------------------------------------------------------------------------------

    def _robot_at(self, q: Sequence[float]) -> EmulatedRobot:
        lags = [self._profile.lag_of(axis) for axis in self._arm.names]
        return EmulatedRobot(q, self._profile.cycle, lags)

    def _begin(self) -> Run:
        """RSI_ON: the program keeps the robot where it now stands."""
        self._asked = self._short = False
        self._begins = True
        return Run(self._profile, self._context, self._ethernet, self._arm, self._robot.q)

    def _go(self, event: Event, why: str) -> None:
        state = after(self._state, event)
        if state is None or (state is self._state and event is Event.ANSWERED):
            return
        tell = self._notes.info if event in (*PENDANT, Event.ANSWERED) else self._notes.warning
        tell(state.value, why, before=self._state.value, delay=self._run.lateness.count)
        self._state, self._message = state, why

    def _first_ipoc(self, start: int | None) -> Ipoc:
        bits = self._profile.ipoc_bits
        value = self._chance.getrandbits(31) if start is None else start
        return Ipoc(value, self._profile.ipoc_step, bits)

    def _refuse_absent_axes(self) -> None:
        absent = [name for name in E_AXES if name not in self._arm.names]
        corrected = [e.name for e in self._ethernet.corrections(tuple(absent)) if e is not None]
        if corrected and self._profile.separate_external:
            raise KrcError(
                f"RECEIVE declares {', '.join(corrected)}, but the robot has no such external axis: "
                f"AXISCORREXT fails on {self._profile.name}; remove them, or give a robot that has them"
            )
