"""Server under test: its address, and the facts that it sends about itself."""

import asyncio
import ssl
from collections.abc import Callable
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass, field
from itertools import count

from armgate.conformance.case import Violation
from armgate.conformance.codec import Fields
from armgate.conformance.command_log import CommandLog
from armgate.conformance.connection import Connection
from armgate.conformance.fault_injection import Faults, Proxy
from armgate.conformance.wire_log import WireLog

_TIMEOUT = 10.0
_ROLES = ("operator", "controller", "observer")


class Unreachable(Exception):  # noqa: N818 (the name is printed)
    """No server that implements this protocol is at that address."""

    exit_code = 2


@dataclass(frozen=True)
class Target:
    """Address of the server under test, and how to connect.

    Attributes:
        host: Its name or address.
        port: Its port.
        tokens: Tokens by role; hello carries that of the highest role.
        tls: TLS context; None: no TLS.
        faults: Faults that the kit's proxy injects into the connections of cases.
        proxy: That proxy; None: connections are direct.
        base_timeout: Longest time until an answer without faults, s.
        start_another: Starts another server of the same kind and ends it on exit; None: the kit starts none.
    """

    host: str
    port: int
    tokens: dict[str, str] = field(default_factory=dict)
    tls: ssl.SSLContext | None = None
    faults: Faults = field(default_factory=Faults)
    proxy: Proxy | None = None
    base_timeout: float = _TIMEOUT
    start_another: Callable[[], AbstractAsyncContextManager[tuple[str, int]]] | None = None

    @property
    def token(self) -> str | None:
        """Token that hello carries; None: no token."""
        return next((self.tokens[role] for role in _ROLES if role in self.tokens), None)

    @property
    def timeout(self) -> float:
        """Longest time until an answer, s."""
        return self.base_timeout + 4 * self.faults.delay

    async def connect(
        self,
        make: Callable[[], Connection],
        *,
        direct: bool = False,
        plain: bool = False,
        tls: ssl.SSLContext | None = None,
    ) -> Connection:
        """Return a new connection.

        Args:
            make: Makes its protocol.
            direct: True to bypass the proxy.
            plain: True to connect without TLS.
            tls: TLS context to use instead of the usual one.

        Raises:
            OSError: The server cannot be reached.
        """
        context = None if plain else tls or self.tls
        host, port = (
            (self.host, self.port) if direct or self.proxy is None else ("127.0.0.1", self.proxy.port)
        )
        loop = asyncio.get_running_loop()
        name = self.host if context else None
        _, connection = await asyncio.wait_for(
            loop.create_connection(make, host, port, ssl=context, server_hostname=name), self.timeout
        )
        return connection

    def hello(self, name: str, role: str, **more: object) -> Fields:
        """Return the first message of a client."""
        token = {} if self.token is None else {"token": self.token}
        return {"type": "hello", "id": 0, "versions": [1], "name": name, "role": role, **token, **more}

    async def handshake(self, connection: Connection, name: str, role: str, **more: object) -> Connection:
        """Send hello, and return the connection after its welcome.

        Raises:
            Violation: No welcome comes.
        """
        connection.send(self.hello(name, role, **more))
        await connection.expect("welcome", re=0)
        return connection

    async def own_client(self, name: str, role: str) -> Connection:
        """Return a connection of the kit itself, direct and after its welcome, that belongs to no case."""
        connection = await self.connect(
            lambda: Connection(name, WireLog(), CommandLog(), self.timeout), direct=True
        )
        return await self.handshake(connection, name, role)


@dataclass(frozen=True)
class ServerInfo:
    """Facts that the server sends about itself before the first case.

    Attributes:
        welcome: Its welcome.
        description: Its cell.
        robot: The robot that is moved.
        participants: Names for lock-step.
    """

    welcome: Fields
    description: Fields
    robot: Fields
    participants: tuple[str, ...] = ()

    @property
    def lockstep(self) -> bool:
        """True if the server runs in lock-step."""
        return bool(self.welcome.get("lockstep"))

    @property
    def ttl(self) -> float:
        """Time without a message of its holder after which a lease expires, s."""
        return float(self.welcome["limits"]["lease_ttl"])

    @property
    def max_age(self) -> int:
        """Oldest tick that a command may be based on, in ticks before the newest."""
        return int(self.welcome["limits"]["max_age_ticks"])


_numbers = count(1)


async def query_server(target: Target, robot: str | None, participants: tuple[str, ...]) -> ServerInfo:
    """Return the facts about the server that the cases need.

    Raises:
        Unreachable: No server is there, or the robot is not in the cell.
    """
    where = f"{target.host}:{target.port}"
    try:
        client = await target.own_client(f"kit-facts-{next(_numbers)}", "observer")
        description = await client.call("describe", "description")
    except (OSError, TimeoutError, Violation) as error:
        raise Unreachable(f"no server of this protocol at {where}: {error}") from error
    client.send({"type": "bye"})
    client.close()
    robots = {each["name"]: each for each in description["robots"]}
    if not robots or (robot is not None and robot not in robots):
        missing = f"no robot {robot}; it has {', '.join(robots)}" if robots else "no robots"
        raise Unreachable(f"the cell at {where} has {missing}")
    chosen = robots[robot] if robot else next(iter(robots.values()))
    return ServerInfo(client.welcome, description, chosen, participants)
