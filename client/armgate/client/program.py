"""Tick programs: controllers written as objects that return one increment per tick.

A program does not wait, and does not depend on the kind of its connection. `run` runs it on a connection to a
daemon; `armgate.programs` runs the same program in a world, where it sends the same messages::

    class Wave(TickProgram):
        def step(self, tick: Tick) -> Increments | None:
            if tick.time > 10.0:
                return None
            return [0.002 * math.sin(tick.time)] + [0.0] * (len(tick.setpoint) - 1)

    with connect("127.0.0.1:7411", name="wave") as cell:
        print(run(cell, "FR", Wave()).text)
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from armgate.client.blocking import Cell, Robot
from armgate.client.errors import BadArgument
from armgate.client.shared_signals import SharedSignals
from armgate.client.tick import Tick
from armgate.protocol.messages import Description, State, Verdict

Increments = Any
"""Increments of a robot's joints (n,), rad or m: a sequence of numbers or an array."""

REST: tuple[float, ...] = ()
"""Result of `Program.step` if no command is sent at this tick."""

SignalValues = Mapping[str, Iterable[float] | float]
"""Values of signals by name, each a number or a short vector."""


@dataclass(frozen=True)
class Outcome:
    """Outcome of a program.

    Attributes:
        text: The outcome in words.
        failed: True if the program failed.
    """

    text: str
    failed: bool = False


INTERRUPTED = Outcome("interrupted")
"""Outcome of a program that was ended by a request; its robot brakes along its plan."""


class Program(Protocol):
    """Controller of one robot, or of none if it only shares signals.

    At each tick, `step` is called first, then `signals`, then `verdict` once the verdict has arrived.
    """

    @property
    def fields(self) -> Sequence[str] | None:
        """Fields of each entry that its ticks contain, as for `Cell.subscribe`; None: all."""

    def step(self, tick: Tick) -> Increments | None:
        """Return the increments (n,) requested at the next tick.

        Args:
            tick: Tick of its robot. Without a robot, the newest state, of any robot.

        Returns:
            The increments in rad or m; `REST` to send no command at this tick, and always without a robot;
                None if the program has ended.
        """

    def signals(self) -> SignalValues:
        """Return the signals to share with the command of the newest tick."""

    def verdict(self, verdict: Verdict) -> None:
        """Take the verdict on the newest command."""

    def interrupt(self) -> bool:
        """Request the program's end; called at every tick from then on, before `step`.

        Returns:
            True if the program brings its robot to rest and then ends by itself. False to end it at once: the
                lease is released, and the robot brakes along its plan.
        """

    @property
    def outcome(self) -> Outcome:
        """Outcome, once the program has ended."""


class TickProgram:
    """Base of simple programs, which implement `step` only; a `Program`."""

    fields: Sequence[str] | None = None
    outcome = Outcome("ended")

    def step(self, tick: Tick) -> Increments | None:
        """Return the increments (n,) requested at the next tick; see `Program.step`."""
        raise NotImplementedError

    def signals(self) -> SignalValues:
        """Return no signals."""
        return {}

    def verdict(self, verdict: Verdict) -> None:
        """Ignore the verdict."""

    def interrupt(self) -> bool:
        """End at once."""
        return False


class ProgramCell(Protocol):
    """Cell from which programs are built: a connection, or a client of a world."""

    @property
    def description(self) -> Description:
        """Description of the cell."""

    def urdf(self, robot: str) -> str:
        """Return the URDF of a robot."""


@dataclass(frozen=True)
class ProgramContext:
    """First argument of a factory of programs: ``make(context, **options) -> Program``.

    Attributes:
        cell: The cell.
        robot: Name of the robot that the program commands; None if it commands none.
        seed: Seed of the program's random numbers.
    """

    cell: ProgramCell
    robot: str | None = None
    seed: int = 0

    @property
    def own(self) -> str:
        """Name of the robot that the program commands.

        Raises:
            BadArgument: There is none.
        """
        if self.robot is None:
            known = ", ".join(robot.name for robot in self.cell.description.robots)
            raise BadArgument(f"this program commands a robot, but none was named; expected one of {known}")
        return self.robot


class EndRequest(Protocol):
    """Request to end a program, for example by Ctrl-C."""

    @property
    def requested(self) -> bool:
        """True once the end is requested."""


class _NoRequest:
    requested = False


def ignore(_text: str) -> None:
    """Print nothing."""


def run(
    cell: Cell,
    robot: str | None,
    program: Program,
    *,
    interrupt: EndRequest | None = None,
    report: Callable[[str], object] = ignore,
) -> Outcome:
    """Run a program on a connection until it ends; acquire its robot before, and release it afterwards.

    Args:
        cell: The connection; its subscription is replaced.
        robot: Name of the robot; None if the program moves none.
        program: The program.
        interrupt: Requests the end.
        report: Prints a line for users, for example if a signal is refused.

    Returns:
        The outcome.

    Raises:
        Refused: The lease or the subscription was refused.
        Lost: The lease was lost, or the robot was stopped.
        ConnectionLost: The connection to the daemon was lost.
        TimedOut: The robot's clock stood still, or the daemon did not answer.
    """
    cell.subscribe(every=1, robots=None if robot is None else [robot], fields=program.fields)
    sharing = SharedSignals(cell, report)
    if robot is None:
        return _share(cell, program, sharing, interrupt or _NoRequest())
    with cell.acquire(robot) as held:
        return run_held(held, program, sharing, interrupt)


def run_held(
    robot: Robot, program: Program, sharing: SharedSignals, interrupt: EndRequest | None = None
) -> Outcome:
    """Run a program on a robot that is acquired already, with a subscription to its ticks.

    Raises the exceptions of `run`, except `Refused` for the lease.
    """
    asked = interrupt or _NoRequest()
    for tick in robot.ticks():
        if asked.requested and not program.interrupt():
            return INTERRUPTED
        dq = program.step(tick)
        if dq is None:
            return program.outcome
        _share_all(sharing, program.signals())
        if len(dq):
            program.verdict(robot.send(dq))
        else:
            robot.skip()
    raise AssertionError("ticks end only by an exception")


def _share(cell: Cell, program: Program, sharing: SharedSignals, asked: EndRequest) -> Outcome:
    """Run a program without a robot at each new state."""
    for state in _once_per_step(cell.states()):
        if asked.requested and not program.interrupt():
            return INTERRUPTED
        if program.step(Tick(state.robot, state)) is None:
            return program.outcome
        _share_all(sharing, program.signals())
        cell.skip()
    raise AssertionError("states end only by an exception")


def _once_per_step(states: Iterator[State]) -> Iterator[State]:
    """Leave out further states of a step in lock-step, which several robots can send."""
    last = None
    for state in states:
        if state.step is None or state.step != last:
            last = state.step
            yield state


def _share_all(sharing: SharedSignals, values: SignalValues) -> None:
    for name, value in values.items():
        sharing.share(name, value)
