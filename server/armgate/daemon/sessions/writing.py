"""Writing to one client: what may not be dropped, the latest states, and batches.

A message that may not be dropped is written or queued, in order, up to a bound. Of each robot's states only
the latest waits, so a slow observer gets the latest state and never a backlog. While the client reads,
nothing waits here.

A *batch* holds frames back, so that everything that belongs together is one packet and wakes the client once.
Batches may overlap: the last one that closes writes what they held back.
"""

import asyncio
from collections import deque
from collections.abc import Callable, Mapping
from types import TracebackType

from armgate.daemon.sessions.peer_socket import PeerSocket

_LOOK = 0.02
"""Time between two looks at the receive window of a client for which states wait, s."""


class Overflow(Exception):  # noqa: N818 (an event of the client, not a defect)
    """The client does not read the messages that may not be dropped."""


class Outbox:
    """Frames that wait for one client.

    Args:
        write: Hands a frame to the transport.
        limit: Bytes of answers and verdicts that may wait.
        reads: Returns True if the client reads: only then are states written.
    """

    def __init__(self, write: Callable[[bytes], None], limit: int, reads: Callable[[], bool]) -> None:
        self._write = write
        self._limit = limit
        self._reads = reads
        self._queue: deque[bytes] = deque()
        self._queued = 0
        self._states: dict[str, bytes] = {}
        self._paused = False

    @property
    def empty(self) -> bool:
        """True if nothing waits."""
        return not self._queue and not self._states

    @property
    def size(self) -> int:
        """Bytes that wait."""
        return self._queued + sum(map(len, tuple(self._states.values())))

    def put(self, frame: bytes) -> None:
        """Send a frame that may not be dropped.

        Raises:
            Overflow: More would wait than the limit allows; the frame was not taken.
        """
        if not self._paused:
            self._write(frame)
            return
        if self._queued + len(frame) > self._limit:
            raise Overflow(f"{self._queued} bytes wait to be read; at most {self._limit} may")
        self._queue.append(frame)
        self._queued += len(frame)

    def put_states(self, frames: Mapping[str, bytes]) -> None:
        """Send the states at a tick of these robots; each replaces one that still waits.

        States are sent in the order of time: an old state of another robot must not follow a newer one.
        """
        for robot, frame in frames.items():
            self._states.pop(robot, None)
            self._states[robot] = frame
        self.write_states()

    def write_states(self) -> None:
        """Write the states that wait, if the client reads."""
        if self._states and not self._paused and self._reads():
            frames, self._states = self._states, {}
            self._write(b"".join(frames.values()))

    def drop_states(self) -> None:
        """Drop the states that wait: they belong to a subscription that has ended."""
        self._states.clear()

    @property
    def states_wait(self) -> bool:
        """True if states wait for the client to read, although the transport would take them."""
        return bool(self._states) and not self._paused

    def pause(self) -> None:
        """Queue everything: the buffer of the transport is full."""
        self._paused = True

    def resume(self) -> None:
        """Write again: first the queue, then the latest states."""
        self._paused = False
        # A write may pause again at once; then the rest keeps waiting.
        while self._queue and not self._paused:
            frame = self._queue.popleft()
            self._queued -= len(frame)
            self._write(frame)
        self.write_states()


class Writer:
    """Writes frames to the transport of one client.

    Args:
        limit: Bytes of answers and verdicts that may wait.
    """

    def __init__(self, limit: int) -> None:
        self._outbox = Outbox(self._write, limit, self._client_reads)
        self._transport: asyncio.Transport
        self._socket: PeerSocket
        self._looking: asyncio.TimerHandle | None = None
        self._batches = 0
        self._held: list[bytes] = []
        self._finishing = False

    def connect(self, transport: asyncio.Transport, socket: PeerSocket) -> None:
        """Write to this transport from now on."""
        self._transport, self._socket = transport, socket

    def close(self) -> None:
        """Cancel timers: the connection is lost."""
        if self._looking is not None:
            self._looking.cancel()

    @property
    def size(self) -> int:
        """Bytes that wait for the client to read."""
        return self._outbox.size

    def send(self, frame: bytes, *, delayable: bool) -> None:
        """Send a frame that may not be dropped; an open batch holds it back only if it is ``delayable``.

        Raises:
            Overflow: The client does not read; the frame was not taken.
        """
        self._outbox.put(frame)
        if self._batches and not delayable:
            self._write_held()

    def send_states(self, frames: Mapping[str, bytes]) -> None:
        """Send the frames of states by robot; each replaces an older one that still waits."""
        self._outbox.put_states(frames)
        self._look_later()

    def drop_states(self) -> None:
        """Drop the states that wait."""
        self._outbox.drop_states()

    def batch(self) -> "WriterBatch":
        """Open a batch."""
        self._batches += 1
        return WriterBatch(self._close_batch, self._write_held)

    def finish(self) -> None:
        """Write the end of the stream after everything that waits, which includes no states."""
        self._finishing = True
        self._outbox.drop_states()
        self._write_end()

    def pause(self) -> None:
        """Queue everything: the kernel takes no more."""
        self._outbox.pause()

    def resume(self) -> None:
        """Write what waits: the kernel takes data again."""
        self._outbox.resume()
        self._look_later()
        if self._finishing:
            self._write_end()

    # --- inside -------------------------------------------------------------------------------------------

    def _write(self, frame: bytes) -> None:
        if self._batches:
            self._held.append(frame)
        elif not self._transport.is_closing():  # else asyncio is about to report the loss of the connection
            self._transport.write(frame)

    def _write_held(self) -> None:
        held, self._held = self._held, []
        if held and not self._transport.is_closing():
            self._transport.write(b"".join(held))

    def _close_batch(self) -> None:
        self._batches -= 1
        if not self._batches:
            self._write_held()

    def _client_reads(self) -> bool:
        return self._transport.is_closing() or self._socket.is_read()

    def _look_later(self) -> None:
        """Look again later, if states wait until the client reads."""
        if self._looking is None and self._outbox.states_wait:
            self._looking = asyncio.get_running_loop().call_later(_LOOK, self._look)

    def _look(self) -> None:
        self._looking = None
        self._outbox.write_states()
        self._look_later()

    def _write_end(self) -> None:
        # If a socket is closed while data of the client are unread, the kernel discards what was written
        # last. So write the end of the stream, and read on until the client closes. TLS does the same on
        # its own.
        self._write_held()
        if self._outbox.empty and not self._transport.is_closing():
            try:
                if self._transport.can_write_eof():
                    self._transport.write_eof()
                else:
                    self._transport.close()
            except OSError:  # the client has reset the connection in the meantime
                self._transport.abort()


class WriterBatch:
    """An open batch of a `Writer`; a context manager that closes it.

    Args:
        close: Closes one batch of the writer.
        flush: Writes what all batches of the writer hold back.
    """

    def __init__(self, close: Callable[[], None], flush: Callable[[], None]) -> None:
        self._close = close
        self._flush = flush
        self._open = True

    def close(self) -> None:
        """End the batch; the last open one writes what was held back."""
        if self._open:
            self._open = False
            self._close()

    def flush(self) -> None:
        """Write everything that was held back, even if another batch is open."""
        self._flush()

    def __enter__(self) -> "WriterBatch":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
