"""Virtual KRC without time and sockets: given the datagrams of a cycle, it returns the next telegram.

At the beginning of a cycle the KRC takes the reply to its last telegram, corrects the setpoint, passes it to
the drives, and sends the next telegram with the position measured at that moment. A reply therefore affects
the telegram after the next one at the earliest.
"""

from collections.abc import Iterable, Sequence
from random import Random

from armgate.emulator.krc.context import Context
from armgate.emulator.krc.errors import KrcError
from armgate.emulator.krc.log import EventLog
from armgate.emulator.krc.profile import Profile
from armgate.emulator.krc.robot.arm import Arm
from armgate.emulator.krc.rsi.ethernet import E_AXES, Ethernet
from armgate.emulator.krc.rsi.ipoc import Ipoc
from armgate.emulator.krc.rsi.reply import Reply, ReplyParser
from armgate.emulator.krc.rsi.reply_filter import Arrival, ReplyFilter
from armgate.emulator.krc.rsi.telegram import TelegramValues, TelegramWriter
from armgate.emulator.krc.rsi_run import RsiRun
from armgate.emulator.krc.states import ACTIVE, Event, State, next_state
from armgate.emulator.robot import EmulatedRobot

PENDANT = (Event.START, Event.STOP, Event.PAUSE, Event.RESUME, Event.ESTOP, Event.RESET, Event.RESTART)
"""Events that an operator can cause at the pendant."""


class Controller:
    """One virtual KRC, initially stopped.

    Args:
        profile: Profile of the controller.
        context: RSI context.
        ethernet: Content of its RSI Ethernet file.
        arm: Its robot.
        chance: Random numbers for the first IPOC, unless ``ipoc`` is given.
        log: Its log.
        ipoc: First IPOC; None: a random one.

    Raises:
        KrcError: The file corrects axes that the robot does not have, and the controller treats that as an
            error.
    """

    def __init__(
        self,
        profile: Profile,
        context: Context,
        ethernet: Ethernet,
        arm: Arm,
        *,
        chance: Random,
        log: EventLog,
        ipoc: int | None = None,
    ) -> None:
        self._profile, self._context, self._ethernet, self._arm = profile, context, ethernet, arm
        self._chance, self._log = chance, log
        self._refuse_absent_axes()
        self._writer = TelegramWriter(ethernet, context.precision, profile.root)
        self._values = TelegramValues(
            arm, profile.linear_sent, self._writer.needed, moves=context.aspos_moves
        )
        self._filter = ReplyFilter(ReplyParser(ethernet), profile.reply_within, log)
        self._robot = self._robot_at(arm.start)
        self._state, self._message, self._cycles, self._runs = State.STOPPED, "", 0, 0
        self._reply_due = False
        self._first_telegram = True
        self._short_sent = False
        self._ipoc = self._first_ipoc(ipoc)
        self._run = self._start_run()

    # --- operation ----------------------------------------------------------------------------------------

    @property
    def state(self) -> State:
        """State of the KRC."""
        return self._state

    def cycle(self, arrivals: Iterable[Arrival]) -> bytes | None:
        """Run one cycle with the datagrams received in it; return the telegram that begins the next one."""
        self._cycles += 1
        self._robot.step(self._run.drives.setpoint)
        if self._reply_due and not self._ethernet.only_send:
            self._process(self._filter.select(arrivals, self._ipoc))
        self._reply_due = self._state in ACTIVE
        if self._reply_due:
            return self._telegram()
        if self._profile.ipoc_runs:
            self._ipoc.advance()
        return None

    def operate(self, event: Event) -> str | None:
        """Apply an event at the pendant; return the reason if it has no effect."""
        if next_state(self._state, event) is None:
            possible = ", ".join(one.value for one in PENDANT if next_state(self._state, one) is not None)
            return f"{event.value} has no effect while {self._state.value}; possible: {possible}"
        if event is Event.RESTART:
            self._ipoc = self._first_ipoc(None)
        if event in (Event.START, Event.RESTART):
            self._run = self._start_run()
            self._runs += 1
        # Any event first brings the robot to rest, and replies to earlier telegrams are no longer accepted.
        self._run.drives.rest(self._run.drives.setpoint)
        self._reply_due = False
        self._change_state(event, f"{event.value} at the pendant")
        return None

    def jump_ipoc(self, value: int) -> None:
        """Set the number of the next telegram."""
        self._ipoc.jump(value)

    def jog(self, axis: str, by: float) -> str | None:
        """Move an axis by hand, deg or mm; return the reason if it is not possible."""
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
        """Return the whole status; axes are in deg and mm."""
        run, names = self._run, self._arm.names
        return {
            "state": self._state.value,
            "message": self._message,
            "cycles": self._cycles,
            "runs": self._runs,
            "ipoc": self._ipoc.last,
            "delay": run.delay.count,
            "programmed": dict(zip(names, run.programmed, strict=True)),
            "setpoint": dict(zip(names, run.drives.setpoint, strict=True)),
            "measured": dict(zip(names, self._robot.q, strict=True)),
            "rejected": {fault.value: count for fault, count in sorted(self._filter.rejected.items())},
        }

    # --- a cycle ------------------------------------------------------------------------------------------

    def _process(self, reply: Reply | None) -> None:
        """Process the reply of a cycle, or its absence."""
        missing = self._run.receive(None if reply is None else reply.values)
        if reply is not None:
            self._change_state(Event.ANSWERED, "the PC replies")
            self._log_contents(reply, missing)
        late = reply is None and not self._short_sent
        self._short_sent = False
        end = self._run.count_cycle(late) or self._run.move()
        if end is not None:
            event, text = end
            self._run.drives.rest(self._run.drives.setpoint)
            self._change_state(event, text)
        elif late:
            count = self._run.delay.count
            self._log.repeated("late", count, f"no valid reply to IPOC {self._ipoc.last} in time: HOLDON")

    def _log_contents(self, reply: Reply, missing: tuple[str, ...]) -> None:
        """Log unusual contents of a reply, each text once."""
        if missing:
            lacks = ", ".join(missing)
            self._log.once("missing", f"the reply lacks {lacks}, which RECEIVE declares: HOLDON")
            self._log.once(
                "zero", f"{lacks}: 0 until it is received (an override of 0 %, if it is connected to one)"
            )
        if reply.unknown:
            unknown, known = ", ".join(reply.unknown), ", ".join(one.name for one in self._ethernet.received)
            self._log.once("unknown", f"the reply contains {unknown}: ignored; RECEIVE declares {known}")
        cartesian = self._run.received.cartesian()
        if cartesian:
            self._log.once(
                "cartesian",
                f"the reply corrects {', '.join(cartesian)}: this virtual KRC has no Cartesian corrections, "
                f"and nothing moves; correct axes, such as AK.A1",
            )
        text = self._run.received.named("EStr")
        if text:
            self._log.once("estr", f"message from the PC: {text}")

    def _telegram(self) -> bytes:
        ipoc = self._ipoc.send()
        if self._first_telegram and self._profile.short_first:
            self._first_telegram, self._short_sent = False, True
            return self._writer.short(ipoc)
        return self._writer.write(self._values.of(self._run, self._robot.q), ipoc)

    # --- states -------------------------------------------------------------------------------------------

    def _robot_at(self, q: Sequence[float]) -> EmulatedRobot:
        lags = [self._profile.lag_of(axis) for axis in self._arm.names]
        return EmulatedRobot(q, self._profile.cycle, lags)

    def _start_run(self) -> RsiRun:
        """Start a run (RSI_ON); its programmed position is the present position of the robot."""
        self._reply_due = self._short_sent = False
        self._first_telegram = True
        return RsiRun(self._profile, self._context, self._ethernet, self._arm, self._robot.q)

    def _change_state(self, event: Event, reason: str) -> None:
        state = next_state(self._state, event)
        if state is None or (state is self._state and event is Event.ANSWERED):
            return
        record = self._log.info if event in (*PENDANT, Event.ANSWERED) else self._log.warning
        record(state.value, reason, before=self._state.value, delay=self._run.delay.count)
        self._state, self._message = state, reason

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
                f"AXISCORREXT fails on {self._profile.name}; remove them, or choose a robot that has them"
            )
