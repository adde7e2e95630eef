"""A server that the kit starts itself, and ends."""

import asyncio
import re
import shlex
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress

from armgate.conformance.target import Unreachable

_ADDRESS = re.compile(r"(\[[0-9a-fA-F:]+\]|[^\s:]+):(\d+)\s*$")
_START = 60.0
_END = 20.0


@asynccontextmanager
async def served(command: str) -> AsyncIterator[tuple[str, int]]:
    """Host and port of a server that runs meanwhile.

    Args:
        command: Starts it; its first line on stdout must end with HOST:PORT.

    Raises:
        Unreachable: It does not start, or says something else.
    """
    try:
        process = await asyncio.create_subprocess_exec(
            *shlex.split(command), stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.DEVNULL
        )
    except OSError as error:
        raise Unreachable(f"--start: {error}") from error
    try:
        assert process.stdout is not None
        with suppress(TimeoutError):
            first = (await asyncio.wait_for(process.stdout.readline(), _START)).decode(errors="replace")
            if match := _ADDRESS.search(first):
                yield match[1].strip("[]"), int(match[2])
                return
        raise Unreachable(f"--start: {command!r} did not say on which HOST:PORT it listens")
    finally:
        await _end(process)


async def _end(process: asyncio.subprocess.Process) -> None:
    with suppress(ProcessLookupError):
        process.terminate()
    try:
        await asyncio.wait_for(process.communicate(), _END)
    except TimeoutError:
        process.kill()
        await process.communicate()
