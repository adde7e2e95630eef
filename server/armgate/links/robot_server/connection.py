"""One end of the robot server's socket: messages, heartbeat, and the timeout of a silent peer."""

import asyncio
from abc import ABC, abstractmethod
from collections.abc import Callable

from armgate.links.robot_server.codec import CodecError, Decoder
from armgate.links.robot_server.messages import Heartbeat, Message

HEARTBEAT_PERIOD = 0.2
"""Time between two heartbeats, s."""

TIMEOUT = 1.0
"""Time without any message after which the peer counts as stalled, s."""


class PeerTimeout:
    """Timeout of a peer that sends nothing.

    Args:
        now: Time of any monotonic clock, s.
        timeout: Longest time without a message, s.
    """

    def __init__(self, now: float, timeout: float = TIMEOUT) -> None:
        self._received = now
        self._checked = now
        self._timeout = timeout

    def received(self, now: float) -> None:
        """Note that bytes of the peer arrived."""
        self._received = now

    def expired(self, now: float) -> bool:
        """Return True if the peer has stalled.

        If this process itself was paused since the last check, the peer gets at least half of the timeout
        again: what it sent during the pause has not been read yet.
        """
        if now - self._checked > self._timeout / 2:
            self._received = max(self._received, now - self._timeout / 2)
        self._checked = now
        return now - self._received > self._timeout


class Connection(asyncio.Protocol, ABC):
    """One side of a connection between a daemon and the robot server.

    Args:
        now: Clock of the timeout, s.
    """

    def __init__(self, now: Callable[[], float]) -> None:
        self._now = now
        self._decoder = Decoder()
        self._timeout = PeerTimeout(now())
        self._transport: asyncio.Transport
        self._timer: asyncio.TimerHandle | None = None

    # --- what each side defines ---------------------------------------------------------------------------

    @property
    @abstractmethod
    def established(self) -> bool:
        """True once both sides have identified themselves; heartbeats are sent only then."""

    @abstractmethod
    def _receive(self, message: Message) -> None:
        """Handle one message.

        Raises:
            CodecError: The peer must not send it now.
        """

    @abstractmethod
    def _reject(self, reason: str) -> None:
        """End the connection because of what the peer sent."""

    @abstractmethod
    def _stalled(self, reason: str) -> None:
        """End the connection because the peer sends nothing."""

    @abstractmethod
    def send(self, message: Heartbeat) -> None:
        """Send a message; each side also allows its own kinds of messages."""

    # --- asyncio ------------------------------------------------------------------------------------------

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Begin to check the timeout."""
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        self._beat()

    def data_received(self, data: bytes) -> None:
        """Decode and handle messages."""
        self._timeout.received(self._now())
        try:
            for message in self._decoder.push(data):
                self._receive(message)
        except CodecError as error:
            self._reject(str(error))

    def abort(self) -> None:
        """Close at once."""
        self._transport.abort()

    def _stop_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()

    def _beat(self) -> None:
        if self._timeout.expired(self._now()):
            self._stalled(f"stalled: no message within {TIMEOUT:g} s")
            return
        self._timer = asyncio.get_running_loop().call_later(HEARTBEAT_PERIOD, self._beat)
        if self.established:
            self.send(Heartbeat())
