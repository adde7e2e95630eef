"""Server process that the kit starts and ends."""

import asyncio
import re
import shlex
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from tempfile import TemporaryFile
from typing import IO

from armgate.conformance.target import Unreachable

_ADDRESS = re.compile(r"(\[[0-9a-fA-F:]+\]|[^\s:]+):(\d+)\s*$")
_START_TIMEOUT = 60.0
_END_TIMEOUT = 20.0


@asynccontextmanager
async def running_server(command: str) -> AsyncIterator[tuple[str, int]]:
    """Run a server, and return its host and port.

    Args:
        command: Starts it; its first line on stdout must end with HOST:PORT.

    Raises:
        Unreachable: It does not start, or prints another first line.
    """
    with TemporaryFile() as errors:  # a pipe that is not read would block the server
        async with _process(command, errors) as process:
            yield await _address(process, command, errors)


async def _address(process: asyncio.subprocess.Process, command: str, errors: IO[bytes]) -> tuple[str, int]:
    assert process.stdout is not None
    first = b""
    with suppress(TimeoutError):
        first = await asyncio.wait_for(process.stdout.readline(), _START_TIMEOUT)
    if match := _ADDRESS.search(first.decode(errors="replace")):
        return match[1].strip("[]"), int(match[2])
    await _end(process)
    errors.seek(0)
    printed = (first + errors.read()).decode(errors="replace").strip().splitlines()
    why = f"; its last line: {printed[-1][:300]}" if printed else ""
    raise Unreachable(f"--start: the first line of {command!r} does not end with HOST:PORT{why}")


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
        await asyncio.wait_for(process.communicate(), _END_TIMEOUT)
    except TimeoutError:
        process.kill()
        await process.communicate()
