"""Welcome: the answer to a hello."""

from collections.abc import Sequence
from importlib.metadata import version

from armgate.cell.config import CellConfig
from armgate.protocol import INBOUND_LIMIT, OUTBOUND_LIMIT, Dialect
from armgate.protocol import messages as m
from armgate.world.description import BODY_EXACT, SESSIONS, STOP_REPLACES
from armgate.world.interfaces import Client
from armgate.world.to_protocol import answer

_SOFTWARE = f"armgate {version('armgate')}"
"""Read once: it is a file on the disk, and every client that connects gets it."""


class Greeter:
    """Factory of the welcomes of one cell.

    Args:
        config: The cell's configuration.
        start: Start id that plans carry.
        lockstep: True if time passes in lock-step.
        dialects: Supported versions of the protocol.
    """

    def __init__(self, config: CellConfig, start: str, lockstep: bool, dialects: Sequence[Dialect]) -> None:
        server = config.server
        self._limits = m.Limits(
            inbound=INBOUND_LIMIT,
            outbound=OUTBOUND_LIMIT,
            max_age_ticks=config.max_age_ticks,
            lease_ttl=server.lease_ttl,
            signals=server.signals_per_client,
            signal_rate=server.signal_rate,
        )
        self._start = start
        self._lockstep = lockstep
        self._dialects = tuple(dialects)

    @property
    def dialects(self) -> tuple[Dialect, ...]:
        """Supported versions of the protocol."""
        return self._dialects

    def welcome(self, client: Client, hello: m.Hello, spoken: int | None) -> m.Welcome:
        """Return the welcome of a client with which version ``spoken`` of the protocol is in use."""
        return answer(
            m.Welcome,
            hello,
            version=spoken,
            versions=tuple(dialect.version for dialect in self._dialects),
            client_versions=hello.versions,
            capabilities=(BODY_EXACT, STOP_REPLACES, SESSIONS),
            start=self._start,
            session=client.id,
            name=client.name,
            role=client.role,
            lockstep=self._lockstep,
            limits=self._limits,
            software=_SOFTWARE,
        )
