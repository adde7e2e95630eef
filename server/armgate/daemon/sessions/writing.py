"""Writing to one client: messages that may not be dropped, the latest states, and batches.

Frames pass through three stages, always in this order, and skip a stage that is not active:

1. The *queue*, while the transport is paused. A message that may not be dropped is queued, in order, up to a
   bound. Of each robot's states only the latest waits, so a slow observer gets the latest state and never a
   backlog. While the client reads, no frame waits here. In lock-step, states for participants are queued as
   other messages are.
2. The *batch*, while one is open: frames that belong together are one packet and wake the client once.
   Batches may overlap: the last one that closes writes the frames that they held back.
3. The transport.
"""

import asyncio
from collections import deque
from collections.abc import Mapping
from types import TracebackType

from armgate.daemon.sessions.peer_socket import PeerSocket

_POLL = 0.02
"""Time between two checks of the receive window of a client for which states wait, s."""


class Overflow(Exception):  # noqa: N818 (an event of the client, not a defect)
    """Overflow: the client does not read messages that may not be dropped."""


class Writer:
    """Writer of frames to the transport of one client.

    Args:
        limit: Bytes of answers and verdicts that may wait in the queue.
    """

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._transport: asyncio.Transport
        self._socket: PeerSocket
        self._paused = False
        self._queue: deque[bytes] = deque()
        self._queued = 0
        self._states: dict[str, bytes] = {}
        self._keeps_states = False
        self._polling: asyncio.TimerHandle | None = None
        self._batches = 0
        self._held: list[bytes] = []
        self._finishing = False

    def connect(self, transport: asyncio.Transport, socket: PeerSocket) -> None:
        """Write to this transport from now on."""
        self._transport, self._socket = transport, socket

    def close(self) -> None:
        """Cancel timers: the connection is lost."""
        if self._polling is not None:
            self._polling.cancel()

    @property
    def size(self) -> int:
        """Bytes that wait for the client to read."""
        return self._queued + sum(map(len, tuple(self._states.values())))

    # --- 1: the queue -------------------------------------------------------------------------------------

    def send(self, frame: bytes, *, delayable: bool) -> None:
        """Send a frame that may not be dropped; an open batch holds it back only if it is ``delayable``.

        Raises:
            Overflow: More would wait than the limit allows; the frame was not taken.
        """
        if not self._paused:
            self._pass_on(frame)
        elif self._queued + len(frame) > self._limit:
            raise Overflow(f"{self._queued} bytes wait to be read; at most {self._limit} may")
        else:
            self._queue.append(frame)
            self._queued += len(frame)
        if not delayable:
            self.flush()

    def keep_states(self) -> None:
        """Treat states as messages that may not be dropped."""
        self._keeps_states = True

    def send_states(self, frames: Mapping[str, bytes]) -> None:
        """Send the states at a tick of these robots; each replaces one that still waits, unless all are kept.

        States are sent in the order of time: an old state of another robot must not follow a newer one.

        Raises:
            Overflow: States are kept, and more would wait than the limit allows.
        """
        if self._keeps_states:
            for frame in frames.values():
                self.send(frame, delayable=True)
            return
        for robot, frame in frames.items():
            self._states.pop(robot, None)
            self._states[robot] = frame
        self._pass_on_states()

    def drop_states(self) -> None:
        """Drop the states that wait."""
        self._states.clear()

    def pause(self) -> None:
        """Queue all frames: the kernel accepts no more data."""
        self._paused = True

    def resume(self) -> None:
        """Write again: first the queue, then the latest states."""
        self._paused = False
        # A write may pause again at once; then the rest keeps waiting.
        while self._queue and not self._paused:
            frame = self._queue.popleft()
            self._queued -= len(frame)
            self._pass_on(frame)
        self._pass_on_states()
        if self._finishing:
            self._write_end()

    def _pass_on_states(self) -> None:
        """Pass on the states that wait if the client reads; otherwise check again later."""
        if not self._states or self._paused:
            return
        if self._transport.is_closing() or self._socket.is_read():
            frames, self._states = self._states, {}
            self._pass_on(b"".join(frames.values()))
        elif self._polling is None:
            self._polling = asyncio.get_running_loop().call_later(_POLL, self._poll)

    def _poll(self) -> None:
        self._polling = None
        self._pass_on_states()

    # --- 2: the batch -------------------------------------------------------------------------------------

    def batch(self) -> "WriterBatch":
        """Open a batch."""
        self._batches += 1
        return WriterBatch(self)

    def end_batch(self) -> None:
        """End one batch; called by `WriterBatch`."""
        self._batches -= 1
        if not self._batches:
            self.flush()

    def flush(self) -> None:
        """Write all frames that batches hold back."""
        held, self._held = self._held, []
        if held:
            self._write(b"".join(held))

    def _pass_on(self, frame: bytes) -> None:
        if self._batches:
            self._held.append(frame)
        else:
            self._write(frame)

    # --- 3: the transport ---------------------------------------------------------------------------------

    def _write(self, data: bytes) -> None:
        if not self._transport.is_closing():  # else asyncio is about to report the loss of the connection
            self._transport.write(data)

    def finish(self) -> None:
        """Write the end of the stream after the queue; states that wait are dropped."""
        self._finishing = True
        self._states.clear()
        self._write_end()

    def _write_end(self) -> None:
        # If a socket is closed while data of the client are unread, the kernel discards the last data
        # written. So write the end of the stream, and read on until the client closes. TLS does the same on
        # its own.
        self.flush()
        if not self._queue and not self._states and not self._transport.is_closing():
            try:
                if self._transport.can_write_eof():
                    self._transport.write_eof()
                else:
                    self._transport.close()
            except OSError:  # the client has reset the connection in the meantime
                self._transport.abort()


class WriterBatch:
    """Open batch of a `Writer`; a context manager that closes it."""

    def __init__(self, writer: Writer) -> None:
        self._writer = writer
        self._open = True

    def close(self) -> None:
        """End the batch; the last open batch writes the frames that were held back."""
        if self._open:
            self._open = False
            self._writer.end_batch()

    def flush(self) -> None:
        """Write all frames that were held back, even if another batch is open."""
        self._writer.flush()

    def __enter__(self) -> "WriterBatch":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
