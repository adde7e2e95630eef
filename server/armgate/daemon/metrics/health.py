"""Health figures of a daemon, if they are configured."""

import asyncio
from collections.abc import Callable
from typing import TYPE_CHECKING

from armgate.links.log import Log
from armgate.world.interfaces import Gate
from armgate.world.states import Observer

if TYPE_CHECKING:
    from armgate.daemon.metrics.collector import Metrics


class MetricsError(Exception):
    """Metrics that cannot be served; nothing was moved."""

    exit_code = 2


class Health:
    """Metrics of one daemon, which may be switched off.

    Args:
        port: Port on 127.0.0.1 to serve them on; None: off.
        queues: Returns the lengths of queues by name; called in the thread of the metrics.
        log: Receives the port.

    Attributes:
        late: Function that records the lateness of a tick, s; None if metrics are off.
    """

    def __init__(self, port: int | None, queues: Callable[[], dict[str, int]], log: Log) -> None:
        self._port = port
        self._log = log
        self._metrics = None if port is None else _metrics(queues)
        self.late = None if self._metrics is None else self._metrics.late

    @property
    def observers(self) -> list[Observer]:
        """Observers of the states."""
        return [] if self._metrics is None else [self._metrics.show]

    def timed(self, gate: Gate) -> Gate:
        """Return the gate; if metrics are on, the time of its decisions is measured."""
        return gate if self._metrics is None else self._metrics.timed(gate)

    def serve(self) -> None:
        """Serve the metrics.

        Raises:
            MetricsError: The port cannot be listened on.
        """
        if self._metrics is None or self._port is None:
            return
        try:
            port = self._metrics.serve(self._port)
        except OSError as error:
            text = f"metrics.port: cannot listen on 127.0.0.1:{self._port}: {error.strerror or error}"
            raise MetricsError(f"{text}; end the process that uses it, or configure another port") from error
        self._log.info("metrics", host="127.0.0.1", port=port)

    async def close(self) -> None:
        """Stop serving the metrics."""
        if self._metrics is not None:
            await asyncio.to_thread(self._metrics.close)


def _metrics(queues: Callable[[], dict[str, int]]) -> "Metrics":
    from armgate.daemon.metrics.collector import Metrics  # noqa: PLC0415 (an extra, off by default)

    return Metrics(queues)
