"""A server that the kit starts itself, and ends."""

import asyncio
import re
import shlex
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from tempfile import TemporaryFile
from typing import IO

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
    with TemporaryFile() as errors:  # a pipe that nobody empties would hold the server up
        async with _process(command, errors) as process:
            yield await _address(process, command, errors)


async def _address(process: asyncio.subprocess.Process, command: str, errors: IO[bytes]) -> tuple[str, int]:
    assert process.stdout is not None
    first = b""
    with suppress(TimeoutError):
        first = await asyncio.wait_for(process.stdout.readline(), _START)
    if match := _ADDRESS.search(first.decode(errors="replace")):
        return match[1].strip("[]"), int(match[2])
    await _end(process)
    errors.seek(0)
    said = (first + errors.read()).decode(errors="replace").strip().splitlines()
    why = f"; the last that it said: {said[-1][:300]}" if said else ""
    raise Unreachable(f"--start: {command!r} did not say on which HOST:PORT it listens{why}")


@asynccontextmanager
async def _process(command: str, errors: IO[bytes]) -> AsyncIterator[asyncio.subprocess.Process]:
    try:
        process = await asyncio.create_subprocess_exec(
            *shlex.split(command), stdout=asyncio.subprocess.PIPE, stderr=errors
        )
    except (OSError, ValueError) as error:
        raise Unreachable(f"--start: {command!r}: {error}") from error
    try:
        yield process
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
