"""Behaviours of simulated clients: controllers, operators and observers."""

import asyncio
import contextlib
import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from armgate import client as sdk
from armgate.client import aio
from armgate.protocol import VERSIONS
from armgate.protocol import messages as m
from tools.simulate.clients.wire import Wire
from tools.simulate.findings import Findings

ADDRESS = ("127.0.0.1", 7411)
_LONG_STEP = 0.2
"""Time after which a participant ends a step for which it has sent nothing more, s."""


@dataclass
class Setting:
    """State that all clients of a simulation share.

    Attributes:
        findings: Receives violations.
        lockstep: True if the daemon runs in lock-step.
        steps: Largest increment of each robot's joints, rad.
        cell: Hash of the cell.
        robots: Address of the robot server.
        robots_held: Returns True if a daemon is connected to the robot server, and its links are ready.
        pace: Factor of the pauses of clients: their acts per tick depend little on the period.
        tokens: Secrets by the name of the client; empty without login.
        holders: Latest lease of each robot that a raw client was granted, and its connection.
        fences: Latest fence of each robot that any client was granted.
        over: True once clients must end.
        calm: True once clients send nothing unusual.
    """

    findings: Findings
    lockstep: bool
    steps: dict[str, Sequence[float]]
    cell: str
    robots: str
    robots_held: Callable[[], bool]
    pace: float
    tokens: dict[str, str] = field(default_factory=dict)
    holders: dict[str, tuple[int, Wire]] = field(default_factory=dict)
    fences: dict[str, int] = field(default_factory=dict)
    over: bool = False
    calm: bool = False


class Walk:
    """Random motion of one robot: it keeps a direction for a while, also into limits and obstacles."""

    def __init__(self, rng: random.Random, largest: Sequence[float]) -> None:
        self._rng, self._largest = rng, largest
        self._direction = [0.0] * len(largest)
        self._left = 0

    def increment(self) -> tuple[float, ...]:
        """Return the next increment, rad."""
        if self._left <= 0:
            self._left = self._rng.randint(3, 60)
            self._direction = [self._rng.choice((-1, -1, -0.3, 0, 0.3, 1, 1, 1.4)) for _ in self._largest]
        self._left -= 1
        return tuple(d * s for d, s in zip(self._direction, self._largest, strict=True))


class RawClient:
    """Client that connects again and again, and acts at random; the base of all behaviours."""

    role: m.Role = "controller"
    pause = (0.0, 0.05)

    def __init__(self, name: str, setting: Setting, rng: random.Random) -> None:
        self.name, self.setting, self.rng = name, setting, rng
        self.wire: Wire
        self._walks = {robot: Walk(rng, steps) for robot, steps in setting.steps.items()}
        self._seq = 0
        self._pinged = 0.0
        self._quiet_until = 0.0

    async def run(self) -> None:
        """Connect, act, and connect again until the end."""
        loop = asyncio.get_running_loop()
        while not self.setting.over:
            self.wire = Wire(
                self.name, self.setting.findings, self._take, self._granted, lockstep=self.setting.lockstep
            )
            try:
                async with asyncio.timeout(3.0):
                    await loop.create_connection(lambda: self.wire, *ADDRESS)
            except (OSError, TimeoutError):
                await asyncio.sleep(self.rng.uniform(0.05, 0.4))
                continue
            self.greet()
            await self.live()
            self.wire.abort()
            await self.wire.closed.wait()
            await asyncio.sleep(self.rng.uniform(0.0, 0.3))

    def greet(self) -> None:
        """Send hello."""
        secret = self.setting.tokens.get(self.name)
        self.wire.send(m.Hello(name=self.name, role=self.role, versions=VERSIONS, token=secret))

    def welcomed(self) -> None:
        """Subscribe to states."""
        self.wire.ask(m.Subscribe(every=self.rng.choice((1, 1, 1, 2, 5))))

    async def live(self) -> None:
        """Act until the connection ends."""
        while self.wire.open and not self.setting.over:
            pace = 1.0 if self.setting.calm else self.setting.pace
            await asyncio.sleep(pace * self.rng.uniform(*self.pause))
            if self.wire.open and self.ready:
                self.act()

    @property
    def ready(self) -> bool:
        """True if the client may act: it has been welcomed."""
        return self.wire.welcomed

    def act(self) -> None:
        """Do one thing."""

    def _granted(self, wire: Wire, lease: m.Lease) -> None:
        self.setting.holders[lease.robot] = lease.fence, wire
        self.setting.fences[lease.robot] = lease.fence

    def _take(self, message: m.Message) -> None:
        if isinstance(message, m.Welcome):
            self.welcomed()
        self.take(message)

    def take(self, message: m.Message) -> None:
        """Process a message."""

    # --- what behaviours do ---------------------------------------------------------------------------------

    def command(self, robot: str, fence: int, tick: int, dq: Sequence[float] | None = None) -> None:
        """Send a command."""
        self._seq += 1
        chosen = self._walks[robot].increment() if dq is None else dq
        self.wire.send(
            m.Command(robot=robot, fence=fence, seq=self._seq, tick=max(tick, 0), dq=tuple(chosen))
        )

    def ping(self) -> None:
        """Send a ping, whose time is its number."""
        self._pinged += 1.0
        self.wire.ask(m.Ping(time=self._pinged))

    def stops(self) -> list[int]:
        """Return the stops in force, as the latest states show them."""
        entries = [entry for state in self.wire.states.values() for entry in state.entries]
        return sorted({stop for entry in entries for stop in entry.stops or ()})

    def steal(self) -> None:
        """Command a robot with the current fence of its holder, which is another client most likely."""
        robot = self.any_robot()
        if robot in self.setting.fences:
            state = self.wire.states.get(robot)
            self.command(robot, self.setting.fences[robot], 0 if state is None else state.tick)

    def any_robot(self) -> str:
        """Return a robot."""
        return self.rng.choice(list(self.setting.steps))


class Controller(RawClient):
    """Controller that holds robots and commands them at their ticks, and sometimes does something wrong."""

    def act(self) -> None:
        """Acquire, release, or something unusual."""
        if self._quiet:
            return
        if self.setting.calm:
            self.wire.resume()
        free = [robot for robot in self.setting.steps if robot not in self.wire.held]
        roll = self.rng.random()
        if free and roll < 0.2:
            self.wire.ask(m.Acquire(robot=self.rng.choice(free), speed=self.rng.choice((1.0, 1.0, 0.5))))
        elif roll < 0.3:
            self.ping()
        elif not self.setting.calm:
            self._act_unusually(roll)

    def _act_unusually(self, roll: float) -> None:
        """Do something that a controller rarely does, or nothing."""
        if roll < 0.31 and self.wire.held:
            robot = self.rng.choice(list(self.wire.held))
            self.wire.ask(m.Release(robot=robot, fence=self.wire.held[robot]))
        elif roll < 0.33:
            self.rng.choice((self._wrong, self._wrong, self.steal))()
        elif roll < 0.336:
            self._quiet_until = asyncio.get_running_loop().time() + self.rng.uniform(0.5, 3.0)
        elif roll < 0.34:
            self.rng.choice((self.wire.pause, self.wire.resume, self.wire.resume))()
            self._blindly()
        elif roll < 0.345:
            self.wire.ask(m.Stop(robot=self.rng.choice((None, self.any_robot())), reason="a simulated stop"))
        elif roll < 0.36:
            self.wire.ask(m.Signal(name=f"{self.name}.x", value=(self.rng.random(),)))
        elif roll < 0.365:
            self.wire.ask(m.Acquire(robot=self.any_robot()))
        elif roll < 0.37:
            self.wire.ask(m.Subscribe(every=self.rng.choice((1, 2)), robots=(self.any_robot(),)))

    def _blindly(self) -> None:
        """Command without reading the states in between."""
        for robot, fence in self.wire.held.items():
            state = self.wire.states.get(robot)
            for _ in range(self.rng.randint(1, 12)):
                self.command(robot, fence, 0 if state is None else state.tick)

    @property
    def _quiet(self) -> bool:
        """True while the client sends nothing, so that its leases expire."""
        return not self.setting.calm and asyncio.get_running_loop().time() < self._quiet_until

    def _wrong(self) -> None:
        """Send a command that must be refused, most likely."""
        robot = self.any_robot()
        state = self.wire.states.get(robot)
        tick = 0 if state is None else state.tick
        fence = self.wire.held.get(robot, self.rng.randint(0, 5))
        match self.rng.randrange(6):
            case 0:
                self.command(robot, max(0, fence - 1), tick)
            case 1:
                self.command(robot, fence + 1, tick)
            case 2:
                self.command(robot, fence, tick + self.rng.randint(1, 9))
            case 3:
                self.command(robot, fence, tick - self.rng.randint(1, 12))
            case 4:
                self.command(robot, fence, tick, (float("nan"), 0.0))
            case _:
                self.command(robot, fence, tick, (0.0,) * self.rng.randint(0, 5))

    def take(self, message: m.Message) -> None:
        """Command a robot at its tick."""
        if isinstance(message, m.State):
            robot = message.robot
            if robot in self.wire.held and not self._quiet and self.rng.random() < 0.97:
                self.command(robot, self.wire.held[robot], message.tick)


class Participant(Controller):
    """Participant of a lock-step: it ends every step."""

    pause = (0.0, 0.02)

    def welcomed(self) -> None:
        """Subscribe to all states."""
        self.wire.ask(m.Subscribe(every=1))
        self._step, self._since = -1, asyncio.get_running_loop().time()

    def act(self) -> None:
        """End a step that takes long: the participant may have lost its robots, or have missed states."""
        if self._step >= 0 and asyncio.get_running_loop().time() > self._since + _LONG_STEP:
            self._since = asyncio.get_running_loop().time()
            self.wire.send(m.Pass(step=self._step))
            self.wire.ask(m.Subscribe(every=1))
        super().act()

    def take(self, message: m.Message) -> None:
        """Command the robots that ticked; a participant that holds no robot, or skips a tick, passes."""
        if not isinstance(message, m.State) or message.step is None:
            return
        first, self._step = message.step > self._step, max(message.step, self._step)
        if first:
            self._since = asyncio.get_running_loop().time()
        robot = message.robot
        if robot in self.wire.held and self.rng.random() < 0.95:
            self.command(robot, self.wire.held[robot], message.tick)
        elif robot in self.wire.held or (first and not self.wire.held):
            self.wire.send(m.Pass(step=message.step))


class Operator(RawClient):
    """Operator that resets stops, and sometimes takes over, kicks and stops."""

    role: m.Role = "operator"
    pause = (0.02, 0.3)

    def act(self) -> None:
        """Reset a stop if one is in force."""
        roll = self.rng.random()
        stops = self.stops()
        if stops and roll < 0.7:
            self.wire.ask(m.Reset(stop=self.rng.choice(stops)))
        elif roll < 0.8 or self.setting.calm:
            self.ping()
        elif roll < 0.83:
            self.wire.ask(
                m.Stop(robot=self.rng.choice((None, self.any_robot())), reason="an operator's stop")
            )
        elif roll < 0.88:
            self.wire.ask(m.Acquire(robot=self.any_robot(), takeover=True))
        elif roll < 0.9:
            self.wire.ask(m.Sessions())
        elif roll < 0.905:
            self.wire.ask(m.Kick(session=f"s{self.rng.randint(1, 30)}"))
        elif roll < 0.93:
            self.rng.choice((lambda: self.wire.ask(m.Describe()), self.steal, self.steal))()
        elif self.wire.held and roll < 0.96:
            robot = self.rng.choice(list(self.wire.held))
            self.wire.ask(m.Release(robot=robot, fence=self.wire.held[robot]))


class Observer(RawClient):
    """Observer that sometimes reads slowly."""

    role: m.Role = "observer"
    pause = (0.02, 0.4)

    def act(self) -> None:
        """Pause and resume reading."""
        roll = self.rng.random()
        if self.setting.calm or roll < 0.4:
            self.wire.resume()
            if self.setting.calm and self.wire.complete_since is None:
                self.wire.complete_since = asyncio.get_running_loop().time()
        elif roll < 0.6:
            self.wire.pause()
        elif roll < 0.8:
            self.ping()
        elif roll < 0.85:
            self.wire.ask(m.Acquire(robot=self.any_robot()))
        elif roll < 0.9:
            self.steal()


class Probe(RawClient):
    """Operator that shows in the end that every robot can be reset, acquired and commanded.

    Attributes:
        accepted: Number of commands for each robot that the gate has decided about.
    """

    role: m.Role = "operator"
    pause = (0.05, 0.1)

    def __init__(self, name: str, setting: Setting, rng: random.Random) -> None:
        super().__init__(name, setting, rng)
        self.accepted = dict.fromkeys(setting.steps, 0)

    def act(self) -> None:
        """Reset stops, and acquire what is not held."""
        for stop in self.stops():
            self.wire.ask(m.Reset(stop=stop))
        for robot in self.setting.steps:
            if robot not in self.wire.held:
                self.wire.ask(m.Acquire(robot=robot, takeover=True))

    def take(self, message: m.Message) -> None:
        """Command the robots, and count what the gate has decided about."""
        if isinstance(message, m.State) and message.robot in self.wire.held:
            fence = self.wire.held[message.robot]
            self.command(message.robot, fence, message.tick, (0.0,) * len(self.setting.steps[message.robot]))
        elif isinstance(message, m.Verdict) and message.target is not None:
            self.accepted[message.robot] += 1


class SdkClient:
    """Controller or observer that uses the SDK's asyncio client as a program does."""

    def __init__(self, name: str, setting: Setting, rng: random.Random) -> None:
        self.name, self.setting, self.rng = name, setting, rng
        self.commands = 0

    async def run(self) -> None:
        """Connect, move a robot, and connect again until the end."""
        while not self.setting.over:
            with contextlib.suppress(sdk.ClientError):
                await self._session()
            await asyncio.sleep(self.rng.uniform(0.05, 0.5))

    async def _session(self) -> None:
        token = self.setting.tokens.get(self.name)
        cell = await aio.connect("127.0.0.1:7411", self.name, token=token, timeout=3.0, patience=3.0)
        async with cell:
            robot = self.rng.choice(list(self.setting.steps))
            walk = Walk(self.rng, self.setting.steps[robot])
            async with await cell.acquire(robot) as held:
                self.setting.fences[robot] = held.lease.fence
                left = self.rng.randint(5, 300)
                async for _tick in held.ticks():
                    left -= 1
                    if left < 0 or self.setting.over:
                        return
                    verdict = await held.send(walk.increment())
                    self.commands += 1
                    if verdict.robot != robot:
                        self.setting.findings.report("verdicts of the SDK", f"{self.name}: {verdict}")
