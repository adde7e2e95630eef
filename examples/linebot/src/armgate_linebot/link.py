"""Link that turns the robot's lines into ticks, and plans into setpoints."""

import asyncio
import math

from armgate.events import Joints, LinkChange, LinkState, Plan, PlanAnswer, Rebase, Tick
from armgate.links.kind import LinkContext
from armgate.links.link import Emit
from armgate.links.plan_player import PlanPlayer
from armgate_linebot.kind import LinebotConfig

RETRY = 0.5
"""Time between two attempts to connect, s."""


class LinebotLink:
    """Link to one robot.

    In each cycle of its own clock the robot sends ``POS q1 q2 …`` or, if its drives are off, ``FAULT q1 q2 …
    reason`` (rad and m). It takes one line in return: ``SET q1 q2 …``, ``HOLD`` or ``RESET``. Each line of
    the robot is a tick: the link plays the plan's increment, answers, and only then reports the tick.

    Args:
        own: The robot's ``link`` section.
        robot: Name of the robot.
        joints: Number of its joints.
        context: Start id, clock and notes.
    """

    def __init__(self, own: LinebotConfig, robot: str, joints: int, context: LinkContext) -> None:
        self.robot = robot
        self._own = own
        self._joints = joints
        self._context = context
        self._player = PlanPlayer(robot, context.start)
        self._state = LinkState.WAITING
        self._arming = True  # at the start without an operator, later only after a reset
        self._rebased = False
        self._noted = ""
        self._setpoint: Joints = ()
        self._emit: Emit
        self._task: asyncio.Task[None] | None = None

    # --- the daemon's side --------------------------------------------------------------------------------

    @property
    def remaining(self) -> int:
        """Number of increments left to play if no other plan comes; 0 at rest."""
        return self._player.remaining

    def offer(self, plan: Plan) -> PlanAnswer:
        """Replace the held plan by compare-and-swap; ``inactive`` unless the robot can be moved."""
        if self._state is not LinkState.READY or self._rebased:
            return PlanAnswer(plan.robot, plan.key, False, "inactive")
        return self._player.offer(plan)

    def rebase(self, rebase: Rebase) -> None:
        """Drop the plan; a robot that was lost or faulted becomes ready at its next position."""
        self._player.rebase(rebase)
        self._rebased = True
        self._arming = self._state is not LinkState.READY

    async def open(self, emit: Emit) -> None:
        """Connect to the robot, now and whenever the connection is lost."""
        self._emit = emit
        self._task = asyncio.create_task(self._connect())

    def close(self) -> None:
        """Disconnect: the robot holds its position."""
        if self._task is not None:
            self._task.cancel()

    # --- the robot's side ---------------------------------------------------------------------------------

    async def _connect(self) -> None:
        while True:
            try:
                reader, writer = await asyncio.open_connection(self._own.host, self._own.port)
                try:
                    await self._answer(reader, writer)
                finally:
                    writer.close()
            except TimeoutError:
                self._disarm(LinkState.LOST, f"no line for {self._own.silence:g} s")
            except (OSError, ValueError) as error:
                self._disarm(LinkState.LOST, str(error))
            await asyncio.sleep(RETRY)

    async def _answer(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Answer each line of a connection.

        Raises:
            TimeoutError: No line came in time.
            OSError: The connection was closed.
            ValueError: A line cannot be read.
        """
        while True:
            async with asyncio.timeout(self._own.silence):
                line = (await reader.readline()).decode()
            if not line:
                raise OSError("the robot closed the connection")
            word, *values = line.split()
            q, reason = self._position(values[: self._joints]), " ".join(values[self._joints :])
            if word not in ("POS", "FAULT") or (word == "POS" and reason):
                raise ValueError(f"the line {line[:60]!r}; expected POS or FAULT")
            if word == "FAULT":
                self._disarm(LinkState.FAULTED, reason)
            reply, events = self._tick(q, faulted=word == "FAULT")
            writer.write(f"{reply}\n".encode())
            for event in events:
                self._emit(event)

    def _position(self, values: list[str]) -> Joints:
        q = tuple(map(float, values))
        if len(q) != self._joints or not all(map(math.isfinite, q)):
            raise ValueError(f"the position {values}; expected {self._joints} finite numbers")
        return q

    def _tick(self, q: Joints, *, faulted: bool) -> tuple[str, list[Tick | LinkChange]]:
        """Play this tick's increment; return the reply and the events."""
        if self._state is not LinkState.READY:
            self._setpoint, self._rebased = q, True
        if self._rebased:
            self._player.drop()
        played = self._player.play()
        increment = played.increment or (0.0,) * self._joints
        self._setpoint = tuple(s + d for s, d in zip(self._setpoint, increment, strict=True))
        rebased, self._rebased = self._rebased and self._player.tick > 0, False
        events: list[Tick | LinkChange] = [
            Tick(
                self.robot, self._player.tick, self._context.now(), q, self._setpoint, increment,
                played.key, played.index, rebased,
            )
        ]  # fmt: skip
        if self._arming and not faulted:
            self._arming, self._state = False, LinkState.READY
            events.append(LinkChange(self.robot, LinkState.READY))
        if self._state is LinkState.READY:
            return f"SET {' '.join(map(repr, self._setpoint))}", events
        return "RESET" if self._arming else "HOLD", events

    def _disarm(self, state: LinkState, reason: str) -> None:
        """Play nothing until an operator's reset; report the change, or note why the robot is not ready."""
        if self._state is LinkState.READY:
            self._player.drop()
            self._state = state
            self._emit(LinkChange(self.robot, state, reason))
        elif reason != self._noted:
            self._noted = reason
            self._context.note(reason)
