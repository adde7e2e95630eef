"""Participant of a world: a program that acts once per tick."""

from collections.abc import Callable
from dataclasses import dataclass

from armgate.client.errors import ClientError
from armgate.client.program import INTERRUPTED, Outcome, Program, ProgramContext
from armgate.client.session import CAPABILITIES, build
from armgate.client.shared_signals import SharedSignals
from armgate.client.tick import Tick
from armgate.programs.world_cell import WorldCell
from armgate.protocol import messages as m
from armgate.world import World


@dataclass(frozen=True)
class Controller:
    """Participant of a run in a world.

    Attributes:
        make: Makes the program.
        robot: Name of the robot that the program commands; None if it commands none.
        role: Role of the participant.
        seed: Seed of the program's random numbers.
    """

    make: Callable[[ProgramContext], Program]
    robot: str | None = None
    role: m.Role = "controller"
    seed: int = 0


class Participant:
    """Program that takes part in a world: `act` before each step, `take` after it.

    A participant can be pickled if its program can. A copy belongs to no world until `rejoin`.

    Args:
        world: The world, in which the participant's name has not joined yet.
        name: Name of the participant.
        controller: Its robot and program.
        report: Receives lines for users.

    Attributes:
        program: The program.
        outcome: Outcome of the program; None while it runs.

    Raises:
        ClientError: The lease or the subscription was refused.
        RemoteProtocolError: The name is taken.
    """

    def __init__(
        self, world: World, name: str, controller: Controller, report: Callable[[str], object]
    ) -> None:
        self._name = name
        client = world.join(name, controller.role, CAPABILITIES)
        self.outcome: Outcome | None = None
        self._cell = WorldCell(client)
        self._session = self._cell._session
        self._sharing = SharedSignals(self._cell, report)
        self.program = controller.make(ProgramContext(self._cell, controller.robot, controller.seed))
        self._robot = controller.robot
        self._fence = self._begin()
        self._after = -1
        self._seen = 0
        self._seq: int | None = None
        self._asked = False

    def interrupt(self) -> None:
        """Request the end of the program, as Ctrl-C does."""
        self._asked = True

    def act(self) -> None:
        """Let the program act on its newest tick, if there is one; it leaves the world when it has ended."""
        if self.outcome is not None or self._seq is not None:
            return
        try:
            self._cell._receive()  # between two steps another client may end the session
            tick = self._next()
            if tick is not None:
                self._act(tick)
        except ClientError as error:
            self._end(Outcome(str(error), failed=True))

    def take(self) -> None:
        """Take the messages of a step: the program receives its verdict."""
        if self.outcome is not None:
            return
        self._cell._receive()
        if self._seq is None:
            return
        try:
            verdict = self._session.pending.verdict(self._seq)
            if verdict is None:
                self._session.check()  # the verdict does not come if the session has ended
        except ClientError as error:
            self._end(Outcome(str(error), failed=True))
            return
        if verdict is not None:
            self._seq = None
            self.program.verdict(verdict)

    def leave(self) -> None:
        """End the session, unless it has ended: the lease ends, and the robot brakes along its plan."""
        if self.outcome is None:
            self._end(INTERRUPTED)

    def rejoin(self, world: World) -> None:
        """Continue in a copy of its world: a fork, or a restored world.

        The participant itself is copied with `copy.deepcopy` or by pickling, if its program permits this,
        when the world is copied. A copy can be used after this call only.

        Raises:
            KeyError: The copy has no such client.
        """
        if self.outcome is None:
            self._cell.connect(world.client(self._name))

    def _begin(self) -> int:
        """Subscribe and acquire the robot; return the fence."""
        robots = None if self._robot is None else (self._robot,)
        fields = None if self.program.fields is None else tuple(self.program.fields)
        self._cell.ask(build(m.Subscribe, every=1, robots=robots, fields=fields), m.Subscribed)
        if self._robot is None:
            return 0
        return self._cell.ask(build(m.Acquire, robot=self._robot), m.Lease).fence

    def _next(self) -> Tick | None:
        """Return the newest tick on which the program has not acted yet."""
        self._session.check()
        if self._robot is not None:
            return self._session.next_tick(self._robot, self._fence, self._after)
        found = self._session.next_state(self._seen)
        if found is None:
            return None
        self._seen, state = found
        return Tick(state.robot, state)

    def _act(self, tick: Tick) -> None:
        self._after = tick.tick
        if self._asked and not self.program.interrupt():
            self._end(INTERRUPTED)
            return
        dq = self.program.step(tick)
        if dq is None:
            self._end(self.program.outcome)
            return
        for name, value in self.program.signals().items():
            self._sharing.share(name, value)
        if len(dq) and self._robot is not None:
            self._seq, _ = self._session.command(self._robot, self._fence, tick.tick, dq)
            self._session.pending.expect_verdict(self._seq)

    def _end(self, outcome: Outcome) -> None:
        self.outcome = outcome
        self._cell._receive()
        if self._session.closed is None:
            robot, fence = self._robot, self._fence
            if robot is not None and self._session.leases.holds(robot, fence):
                self._session.ask(build(m.Release, robot=robot, fence=fence))
            self._session.bye()
