"""Reloading of tokens and certificates while the daemon runs."""

import asyncio
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from armgate.daemon.auth.tls import TlsError
from armgate.daemon.auth.tokens import Token, TokenError
from armgate.links.log import Log


@dataclass(frozen=True, slots=True)
class ReloadSource:
    """Source that can be read again.

    Attributes:
        name: Its name in the log.
        read: Reads it; called in a thread.
        use: Uses the result from now on; returns fields for the log.
    """

    name: str
    read: Callable[[], Any]
    use: Callable[[Any], dict[str, object]]


class Reloader:
    """Reloader of sources, which does not delay ticks; a source that cannot be read changes nothing.

    Args:
        sources: Sources, in the order of reading.
        log: Receives the result of each reading.
    """

    def __init__(self, sources: Sequence[ReloadSource], log: Log) -> None:
        self._sources = sources
        self._log = log
        self._requested = False
        self._task: asyncio.Task[None] | None = None

    def request(self) -> None:
        """Read all sources; if they are being read already, read them again afterwards."""
        self._requested = True
        if self._task is None:
            self._task = asyncio.get_running_loop().create_task(self._run())

    async def _run(self) -> None:
        try:
            while self._requested:
                self._requested = False
                for source in self._sources:
                    await self._reload(source)
        finally:
            self._task = None

    async def _reload(self, source: ReloadSource) -> None:
        try:
            found = await asyncio.to_thread(source.read)
        except (TokenError, TlsError, OSError) as error:
            text = f"{error}; the previous {source.name} stay in force"
            self._log.error(f"{source.name}.kept", error=text)
        else:
            self._log.info(f"{source.name}.read", **source.use(found))


def warn_of_unknown_robots(tokens: Iterable[Token], robots: Iterable[str], log: Log) -> None:
    """Warn of tokens that name robots which the cell does not have, such as mistyped names."""
    known = set(robots)
    for token in tokens:
        if unknown := sorted(set(token.robots or ()) - known):
            log.warning("token.robots", token=token.name, unknown=unknown, robots=sorted(known))
