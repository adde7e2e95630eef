"""Daemon in the event loop of a test."""

import asyncio
import io
from contextlib import asynccontextmanager

from armgate.daemon.lifecycle.daemon import Daemon
from armgate.gate import Gate
from armgate.links.log import Log
from support.clients import PATIENCE


@asynccontextmanager
async def serving(cell, **more):
    """Run a daemon and yield its port; ``more`` are further arguments of ``Daemon``, such as its dialects."""
    log = Log(io.StringIO())
    daemon = Daemon(cell, Gate, log, **more)
    port = asyncio.get_running_loop().create_future()
    task = asyncio.create_task(daemon.run(lambda host, number: port.set_result(number)))
    try:
        await asyncio.wait([port, task], return_when=asyncio.FIRST_COMPLETED, timeout=PATIENCE)
        yield port.result()
    finally:
        while not task.done():
            daemon.end()
            await asyncio.wait([task], timeout=PATIENCE)
        log.close()
