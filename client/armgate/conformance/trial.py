"""One case under way: its connections, its commands, what it knows of the server."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import replace
from itertools import count

from armgate.conformance.holder import Holder
from armgate.conformance.ledger import Ledger
from armgate.conformance.log import WireLog
from armgate.conformance.observer import Observer
from armgate.conformance.packing import Fields
from armgate.conformance.target import Facts, Target
from armgate.conformance.verdicts import Skip, Unmet
from armgate.conformance.wire import Wire

_numbers = count(1)

_RESETS = 60
"""How often a reset is asked for again, five ticks each."""


class Trial:
    """What a case has at hand.

    Attributes:
        target: The server.
        facts: What it said of itself.
        observer: The kit's own eye.
        log: What went over the wires of this case.
        ledger: Its commands.
        wires: All its connections.
        robot: Name of the robot that is moved.
        n: How many joints that has.
    """

    def __init__(self, target: Target, facts: Facts, observer: Observer, ledger: Ledger) -> None:
        self.target = target
        self.facts = facts
        self.observer = observer
        self.log = WireLog()
        self.ledger = ledger
        self.wires: list[Wire] = []
        self.robot: str = facts.robot["name"]
        self.n = len(facts.robot["joints"])
        self._number = next(_numbers)

    # --- connections --------------------------------------------------------------------------------------

    async def open(self, name: str = "client") -> Wire:
        """A connection that has not said hello.

        Raises:
            Unmet: The server cannot be reached.
        """
        try:
            wire = await self.target.connect(lambda: Wire(name, self.log, self.ledger, self.target.patience))
        except (OSError, TimeoutError) as error:
            raise Unmet(f"{name}: cannot connect: {error}") from error
        self.wires.append(wire)
        return wire

    def name(self, of: str) -> str:
        """A name that no other connection of this run has."""
        return f"kit-{self._number}-{of}"

    async def client(self, role: str = "controller", name: str = "client", **hello: object) -> Wire:
        """A connection that was welcomed."""
        return await self.target.welcomed(await self.open(name), self.name(name), role, **hello)

    async def holder(
        self, role: str = "controller", name: str = "holder", robot: str | None = None, **acquire: object
    ) -> Holder:
        """A connection that holds a robot and sees its states."""
        wire = await self.client(role, name)
        robot = robot or self.robot
        lease = await wire.answered("acquire", "lease", robot=robot, **acquire)
        if lease["state"] != "held":
            raise Unmet(f"{name}: acquire of a free robot was answered by a lease that is {lease['state']}")
        described = next(one for one in self.facts.description["robots"] if one["name"] == robot)
        holder = Holder(wire, described, lease, self.observer)
        await wire.answered("subscribe", "subscribed", every=1, robots=[robot])
        return holder

    async def operator(self) -> Wire:
        """A connection of an operator."""
        return await self.client("operator", "operator")

    @asynccontextmanager
    async def anew(self) -> AsyncIterator[Target]:
        """Another server of the same kind, started for this case and ended with it.

        Raises:
            Skip: The kit did not start the one that it tries.
        """
        if self.target.anew is None:
            raise Skip("needs a second server of the kind: have the kit start it by --start")
        async with self.target.anew() as (host, port):
            yield replace(self.target, host=host, port=port, proxy=None)

    async def call(self, target: Target, name: str) -> Wire:
        """A connection to another server that has not said hello."""
        wire = Wire(name, self.log, Ledger(), self.target.patience)
        await target.connect(lambda: wire)
        self.wires.append(wire)
        return wire

    async def visit(self, target: Target, name: str, role: str = "controller") -> Wire:
        """A connection to another server, welcomed."""
        return await target.welcomed(await self.call(target, name), name, role)

    # --- what a case needs --------------------------------------------------------------------------------

    def other_robot(self) -> str:
        """A second robot.

        Raises:
            Skip: The cell has none.
        """
        for robot in self.facts.description["robots"]:
            if robot["name"] != self.robot:
                return str(robot["name"])
        raise Skip("the cell has one robot only")

    def out_of_reach(self, robot: str) -> bool:
        """Whether the link of a robot is not ready; one that has never ticked is not."""
        return self.observer.entries.get(robot, {}).get("link") != "ready"

    async def freed(self, robot: str | None = None, within: float | None = None) -> None:
        """Wait until the observer sees that nobody holds the robot."""
        name = robot or self.robot
        await self.observer.until(lambda: self.entry(name)["holder"] is None, f"{name} to be free", within)

    async def lifted(self, wire: Wire, stop: int) -> Fields:
        """The answer to a reset that lifts a stop."""
        return await lifted(wire, stop, self.observer)

    async def rested(self, robot: str | None = None) -> None:
        """Wait until the observer sees the robot at rest."""
        name = robot or self.robot
        await self.observer.ticks(name, 2)
        await self.observer.until(lambda: self.observer.rests(name), f"{name} to rest")

    def entry(self, robot: str | None = None) -> dict[str, object]:
        """A robot's entry in the newest state that the observer saw."""
        return self.observer.entries[robot or self.robot]


async def lifted(wire: Wire, stop: int, observer: Observer) -> Fields:
    """The answer to a reset that lifts a stop; asked for again while robots still follow.

    Raises:
        Unmet: It is refused otherwise, or for too long.
    """
    robot = next(iter(observer.entries))
    for _ in range(_RESETS):
        answer = await wire.ask("reset", stop=stop)
        if answer.get("code") != "moving":
            break
        await observer.ticks(robot, 5)
    if answer["type"] != "resumed":
        raise Unmet(f"{wire.name}: reset of stop {stop} at rest was answered by {answer}")
    return answer
