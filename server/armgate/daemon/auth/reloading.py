"""Files that are read again while the daemon runs: tokens and certificates."""

import asyncio
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from armgate.daemon.auth.tls import TlsError
from armgate.daemon.auth.tokens import Token, TokenError
from armgate.links.log import Log


@dataclass(frozen=True, slots=True)
class ReloadSource:
    """Something that is read again.

    Attributes:
        name: What it is, for the log.
        read: Reads it; called in a thread.
        use: Uses it from now on; returns what the log shall say of it.
    """

    name: str
    read: Callable[[], Any]
    use: Callable[[Any], dict[str, object]]


class Reloader:
    """Reads files again when asked, beside the ticks; what cannot be read changes nothing.

    Args:
        sources: What is read, one after the other.
        log: Where it is logged what became of them.
    """

    def __init__(self, sources: Sequence[ReloadSource], log: Log) -> None:
        self._sources = sources
        self._log = log
        self._wanted = False
        self._task: asyncio.Task[None] | None = None

    def ask(self) -> None:
        """Read what the files hold from now on; once more if asked again meanwhile."""
        self._wanted = True
        if self._task is None:
            self._task = asyncio.get_running_loop().create_task(self._run())

    async def _run(self) -> None:
        try:
            while self._wanted:
                self._wanted = False
                for source in self._sources:
                    await self._read(source)
        finally:
            self._task = None

    async def _read(self, source: ReloadSource) -> None:
        try:
            found = await asyncio.to_thread(source.read)
        except (TokenError, TlsError, OSError) as error:
            text = f"{error}; the {source.name} read before stay in force"
            self._log.error(f"{source.name}.kept", error=text)
        else:
            self._log.info(f"{source.name}.read", **source.use(found))


def warn_of_unknown_robots(tokens: Iterable[Token], robots: Iterable[str], log: Log) -> None:
    """Warn of tokens for robots that the cell does not have: a name is mistyped."""
    known = set(robots)
    for token in tokens:
        if strange := sorted(set(token.robots or ()) - known):
            log.warning("token.robots", token=token.name, unknown=strange, robots=sorted(known))
