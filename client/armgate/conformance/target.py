"""The server under test: how it is reached, and what it said of itself."""

import asyncio
import ssl
from collections.abc import Callable
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass, field
from itertools import count

from armgate.conformance.faults import Faults
from armgate.conformance.ledger import Ledger
from armgate.conformance.log import WireLog
from armgate.conformance.packing import Fields
from armgate.conformance.proxy import Proxy
from armgate.conformance.verdicts import Unmet
from armgate.conformance.wire import Wire

_PATIENCE = 10.0
_ROLES = ("operator", "controller", "observer")


class Unreachable(Exception):  # noqa: N818 (names what the user sees)
    """There is no server that speaks this protocol at that address."""

    exit_code = 2


@dataclass
class Target:
    """Where the server is, and who may come in.

    Attributes:
        host: Its name or address.
        port: Its port.
        tokens: Those given, by role; the highest is what hello carries.
        tls: Encrypts, None: not.
        faults: What the kit's proxy does to the connections of cases.
        proxy: That proxy, None: connections are direct.
        longest: How long an answer may take without faults, s.
        anew: Starts another server of the same kind, that runs meanwhile; None: the kit starts none.
    """

    host: str
    port: int
    tokens: dict[str, str] = field(default_factory=dict)
    tls: ssl.SSLContext | None = None
    faults: Faults = field(default_factory=Faults)
    proxy: Proxy | None = None
    longest: float = _PATIENCE
    anew: Callable[[], AbstractAsyncContextManager[tuple[str, int]]] | None = None

    @property
    def token(self) -> str | None:
        """What hello carries, None: nothing."""
        return next((self.tokens[role] for role in _ROLES if role in self.tokens), None)

    @property
    def patience(self) -> float:
        """How long an answer may take, s."""
        return self.longest + 4 * self.faults.delay

    async def connect(
        self,
        make: Callable[[], Wire],
        *,
        direct: bool = False,
        plain: bool = False,
        tls: ssl.SSLContext | None = None,
    ) -> Wire:
        """A connection.

        Args:
            make: Makes its protocol.
            direct: Past the proxy.
            plain: Without TLS.
            tls: Another way to encrypt.

        Raises:
            OSError: The server cannot be reached.
        """
        context = None if plain else tls or self.tls
        host, port = (
            (self.host, self.port) if direct or self.proxy is None else ("127.0.0.1", self.proxy.port)
        )
        loop = asyncio.get_running_loop()
        name = self.host if context else None
        _, wire = await asyncio.wait_for(
            loop.create_connection(make, host, port, ssl=context, server_hostname=name), self.patience
        )
        return wire

    def hello(self, name: str, role: str, **more: object) -> Fields:
        """The first message of a client."""
        token = {} if self.token is None else {"token": self.token}
        return {"type": "hello", "id": 0, "versions": [1], "name": name, "role": role, **token, **more}

    async def welcomed(self, wire: Wire, name: str, role: str, **more: object) -> Wire:
        """Have a connection welcomed.

        Raises:
            Unmet: It is not.
        """
        wire.say(self.hello(name, role, **more))
        await wire.expect("welcome", re=0)
        return wire

    async def helper(self, name: str, role: str) -> Wire:
        """A connection of the kit's own, direct and welcomed, that belongs to no case."""
        wire = await self.connect(lambda: Wire(name, WireLog(), Ledger(), self.patience), direct=True)
        return await self.welcomed(wire, name, role)


@dataclass(frozen=True)
class Facts:
    """What the server says of itself before the first case.

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
        """Whether its time passes in lock-step."""
        return bool(self.welcome.get("lockstep"))

    @property
    def ttl(self) -> float:
        """How long a lease lives without a sign of life, s."""
        return float(self.welcome["limits"]["lease_ttl"])

    @property
    def max_age(self) -> int:
        """The oldest tick that a command may be based on, in ticks before the newest."""
        return int(self.welcome["limits"]["max_age_ticks"])


_numbers = count(1)


async def ask(target: Target, robot: str | None, participants: tuple[str, ...]) -> Facts:
    """Learn what the cases need to know.

    Raises:
        Unreachable: Nobody is there, or the robot is not in the cell.
    """
    where = f"{target.host}:{target.port}"
    try:
        wire = await target.helper(f"kit-facts-{next(_numbers)}", "observer")
        description = await wire.answered("describe", "description")
    except (OSError, TimeoutError, Unmet) as error:
        raise Unreachable(f"no server that can be tried at {where}: {error}") from error
    wire.say({"type": "bye"})
    wire.close()
    found = {one["name"]: one for one in description["robots"]}
    if not found or (robot is not None and robot not in found):
        raise Unreachable(
            f"the cell at {where} has no robot {robot or ''}; it has {', '.join(found) or 'none'}"
        )
    return Facts(
        wire.welcome, description, found[robot] if robot else next(iter(found.values())), participants
    )
