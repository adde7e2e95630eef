"""What waits to be written to one client: messages that may not be dropped, and the newest states."""

from collections import deque
from collections.abc import Callable, Mapping


class Overflow(Exception):  # noqa: N818 (an event of the client, not a defect)
    """The client does not read what may not be dropped."""


class Outbox:
    """Frames for one client.

    Answers and verdicts are queued, in order, up to a bound. Of each robot's states only the newest waits, so
    a slow observer gets the newest state and never a backlog. While the client reads, nothing waits here.

    Args:
        write: Hands a frame to the transport.
        limit: How many bytes of answers and verdicts may wait.
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
        """Whether nothing waits."""
        return not self._queue and not self._states

    @property
    def size(self) -> int:
        """How many bytes wait."""
        return self._queued + sum(map(len, tuple(self._states.values())))

    def put(self, frame: bytes) -> None:
        """Send a frame that may not be dropped.

        Raises:
            Overflow: More waits than the limit allows; the frame was not taken.
        """
        if not self._paused:
            self._write(frame)
            return
        if self._queued + len(frame) > self._limit:
            raise Overflow(f"{self._queued} bytes wait to be read; at most {self._limit} may")
        self._queue.append(frame)
        self._queued += len(frame)

    def put_states(self, frames: Mapping[str, bytes]) -> None:
        """Send the states at a tick of these robots, each in place of one that still waits.

        States go in the order of time: an old one of another robot must not follow a newer one.
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
        """True if states wait for the client to read, and the transport would take them."""
        return bool(self._states) and not self._paused

    def pause(self) -> None:
        """The transport's buffer is full: let everything wait."""
        self._paused = True

    def resume(self) -> None:
        """The transport takes frames again: first the queue, then the newest states."""
        self._paused = False
        # A write may pause again at once: what is left keeps waiting.
        while self._queue and not self._paused:
            frame = self._queue.popleft()
            self._queued -= len(frame)
            self._write(frame)
        self.write_states()
