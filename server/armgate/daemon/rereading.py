"""The tokens, read anew while the daemon runs."""

import asyncio
from collections.abc import Callable, Iterable

from armgate.daemon.log import Log
from armgate.daemon.tokens import Token, TokenError, Tokens


class Rereading:
    """Reads tokens when it is asked to, beside the ticks; what cannot be read changes nothing.

    Args:
        read: Gives the tokens that stand in the file now; called in a thread of its own.
        use: Told of them.
        log: Where it is told what became of them.
    """

    def __init__(self, read: Callable[[], Tokens], use: Callable[[Tokens], None], log: Log) -> None:
        self._read = read
        self._use = use
        self._log = log
        self._wanted = False
        self._task: asyncio.Task[None] | None = None

    def ask(self) -> None:
        """Read what stands there from now on; once more if that is asked for meanwhile."""
        self._wanted = True
        if self._task is None:
            self._task = asyncio.get_running_loop().create_task(self._run())

    async def _run(self) -> None:
        while self._wanted:
            self._wanted = False
            try:
                tokens = await asyncio.to_thread(self._read)
            except TokenError as error:
                self._log.error("tokens.kept", error=f"{error}; the tokens read before stay in force")
            else:
                self._use(tokens)
                self._log.info("tokens.read", names=[token.name for token in tokens])
        self._task = None


def tell_strange(tokens: Iterable[Token], robots: Iterable[str], log: Log) -> None:
    """Warn of tokens for robots that the cell has not: somebody has mistyped a name."""
    known = set(robots)
    for token in tokens:
        if strange := sorted(set(token.robots or ()) - known):
            log.warning("token.robots", token=token.name, unknown=strange, robots=sorted(known))
