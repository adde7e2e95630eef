"""Context of a running case: its connections, its commands, and the facts about the server."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import replace
from itertools import count

from armgate.conformance.case import Skip, Violation
from armgate.conformance.codec import Fields
from armgate.conformance.command_log import CommandLog
from armgate.conformance.connection import Connection
from armgate.conformance.lease_holder import LeaseHolder
from armgate.conformance.observer import Observer
from armgate.conformance.target import ServerInfo, Target
from armgate.conformance.wire_log import WireLog

_numbers = count(1)

_RESETS = 60
"""Number of attempts of a reset, five ticks apart."""


class CaseContext:
    """Connections, logs and server facts of a running case.

    Attributes:
        target: The server.
        server: Its welcome and its cell.
        observer: The kit's observer.
        log: Log of the bytes of this case's connections.
        commands: Log of its commands.
        connections: All its connections.
        robot: Name of the robot that is moved.
        n: Number of its joints.
    """

    def __init__(self, target: Target, server: ServerInfo, observer: Observer, commands: CommandLog) -> None:
        self.target = target
        self.server = server
        self.observer = observer
        self.log = WireLog()
        self.commands = commands
        self.connections: list[Connection] = []
        self.robot: str = server.robot["name"]
        self.n = len(server.robot["joints"])
        self._number = next(_numbers)

    # --- connections --------------------------------------------------------------------------------------

    async def connect(self, name: str = "client") -> Connection:
        """Return a new connection that has not sent hello.

        Raises:
            Violation: The server cannot be reached.
        """
        timeout = self.target.timeout
        try:
            connection = await self.target.connect(lambda: Connection(name, self.log, self.commands, timeout))
        except (OSError, TimeoutError) as error:
            raise Violation(f"{name}: cannot connect: {error}") from error
        self.connections.append(connection)
        return connection

    def name(self, of: str) -> str:
        """Return a client name that no other connection of this run has."""
        return f"kit-{self._number}-{of}"

    async def client(self, role: str = "controller", name: str = "client", **hello: object) -> Connection:
        """Return a new connection after its welcome."""
        return await self.target.handshake(await self.connect(name), self.name(name), role, **hello)

    async def holder(
        self, role: str = "controller", name: str = "holder", robot: str | None = None, **acquire: object
    ) -> LeaseHolder:
        """Return a new client that has acquired a robot and subscribed to its states."""
        client = await self.client(role, name)
        robot = robot or self.robot
        lease = await client.call("acquire", "lease", robot=robot, **acquire)
        if lease["state"] != "held":
            raise Violation(
                f"{name}: acquire of a free robot was answered by a lease that is {lease['state']}"
            )
        described = next(each for each in self.server.description["robots"] if each["name"] == robot)
        holder = LeaseHolder(client, described, lease, self.observer)
        await client.call("subscribe", "subscribed", every=1, robots=[robot])
        return holder

    async def operator(self) -> Connection:
        """Return a new client with the role operator."""
        return await self.client("operator", "operator")

    # --- a second server ----------------------------------------------------------------------------------

    @asynccontextmanager
    async def second_server(self) -> AsyncIterator[Target]:
        """Start another server of the same kind for this case, and end it afterwards.

        Raises:
            Skip: The kit did not start the server under test.
        """
        if self.target.start_another is None:
            raise Skip("needs a second server of the same kind: give --start")
        async with self.target.start_another() as (host, port):
            yield replace(self.target, host=host, port=port, proxy=None)

    async def connect_to(self, target: Target, name: str) -> Connection:
        """Return a new connection to another server that has not sent hello."""
        connection = Connection(name, self.log, CommandLog(), self.target.timeout)
        await target.connect(lambda: connection)
        self.connections.append(connection)
        return connection

    async def client_of(self, target: Target, name: str, role: str = "controller") -> Connection:
        """Return a new connection to another server after its welcome."""
        return await target.handshake(await self.connect_to(target, name), name, role)

    # --- robots -------------------------------------------------------------------------------------------

    def other_robot(self) -> str:
        """Return the name of a second robot.

        Raises:
            Skip: The cell has none.
        """
        for robot in self.server.description["robots"]:
            if robot["name"] != self.robot:
                return str(robot["name"])
        raise Skip("the cell has only one robot")

    def link_not_ready(self, robot: str) -> bool:
        """Return True if the link of a robot is not ready; this includes robots that have never ticked."""
        return self.observer.entries.get(robot, {}).get("link") != "ready"

    async def wait_free(self, within: float | None = None) -> None:
        """Wait until the observer receives a state in which no client holds the robot."""
        free = f"{self.robot} to be free"
        await self.observer.until(lambda: self.entry()["holder"] is None, free, within)

    async def reset_stop(self, client: Connection, stop: int) -> Fields:
        """Reset a stop, and return the answer."""
        return await reset_stop(client, stop, self.observer)

    async def wait_at_rest(self) -> None:
        """Wait until the observer receives states in which the robot is at rest."""
        await self.observer.ticks(self.robot, 2)
        at_rest = f"{self.robot} to be at rest"
        await self.observer.until(lambda: self.observer.is_at_rest(self.robot), at_rest)

    def entry(self, robot: str | None = None) -> dict[str, object]:
        """Return the entry of a robot in the newest state that the observer received."""
        return self.observer.entries[robot or self.robot]


async def reset_stop(client: Connection, stop: int, observer: Observer) -> Fields:
    """Reset a stop, and return the answer; repeat the request while robots still brake.

    Raises:
        Violation: It is refused for another cause, or for too long.
    """
    robot = next(iter(observer.entries))
    for _ in range(_RESETS):
        answer = await client.request("reset", stop=stop)
        if answer.get("code") != "moving":
            break
        await observer.ticks(robot, 5)
    if answer["type"] != "resumed":
        raise Violation(f"{client.name}: reset of stop {stop} at rest was answered by {answer}")
    return answer
