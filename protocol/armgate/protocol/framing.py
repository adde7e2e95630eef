"""Length-prefixed frames: a 4-byte big-endian length, followed by that many bytes of payload.

``frame(payload) -> bytes`` encodes one frame; :class:`FrameDecoder` divides a stream into payloads. The
decoder checks a length before it waits for the payload. Limits of the protocol: ``HANDSHAKE_LIMIT`` (to the
server, before its welcome), ``INBOUND_LIMIT`` (to the server), ``OUTBOUND_LIMIT`` (to the client).

This module imports nothing: the socket between the daemon and a robot server uses the same frames.
"""

HEADER = 4
HANDSHAKE_LIMIT = 4 * 1024
INBOUND_LIMIT = 64 * 1024
OUTBOUND_LIMIT = 1024 * 1024


class FrameError(Exception):
    """A frame whose length is 0 or beyond the limit.

    Attributes:
        length: The length in the frame's header.
        limit: The longest payload accepted.
    """

    def __init__(self, length: int, limit: int) -> None:
        beyond = f"a frame of {length} bytes; at most {limit} are accepted here"
        super().__init__(beyond if length else "a frame of length 0")
        self.length = length
        self.limit = limit


def frame(payload: bytes) -> bytes:
    """Return ``payload`` as one frame."""
    return len(payload).to_bytes(HEADER, "big") + payload


class FrameDecoder:
    """Decoder of a stream of frames; the result does not depend on how the stream is divided.

    After ``feed``, less than one frame is in the buffer. With ``push`` and ``pop``, frames may wait
    there. After an error it discards all input and raises the same error again.

    Attributes:
        limit: The longest payload accepted; may be changed between two frames.
        ahead: Number of frames that ``look_ahead`` has returned and ``pop`` has not.
    """

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self._buffer = bytearray()
        self._seen = 0  # bytes of the complete frames at the start of the buffer that were looked at
        self._searched = 0  # offset in the buffer from which `may_hold` continues its search
        self.ahead = 0
        self._needed = HEADER  # bytes to wait for; more once the length of a frame is known
        self._error: FrameError | None = None

    @property
    def buffered(self) -> int:
        """Number of bytes pushed and not yet popped: complete frames that wait, and an incomplete one."""
        return len(self._buffer)

    def feed(self, data: bytes) -> list[bytes]:
        """Add bytes and return all payloads that are now complete.

        Raises:
            FrameError: A length is 0 or beyond the limit.
        """
        self.push(data)
        payloads = []
        while (payload := self.pop()) is not None:
            payloads.append(payload)
        return payloads

    def push(self, data: bytes) -> None:
        """Add bytes, even while frames wait; the caller bounds ``buffered``."""
        if self._error is None:
            self._buffer += data

    def pop(self) -> bytes | None:
        """Return the next complete payload; None if there is none yet.

        Raises:
            FrameError: A length is 0 or beyond the limit.
        """
        if self._error is not None:
            raise self._error
        if len(self._buffer) < self._needed:
            return None
        if self._needed == HEADER:
            length = int.from_bytes(self._buffer[:HEADER], "big")
            self._check(length)
            self._needed = HEADER + length
            if len(self._buffer) < self._needed:
                return None
        payload = bytes(memoryview(self._buffer)[HEADER : self._needed])
        del self._buffer[: self._needed]
        if self._seen or self._searched:
            self._move_search(self._needed)
        self._needed = HEADER
        return payload

    # Looking ahead. The buffer is divided at `_seen`: the frames before it have been looked at and wait for
    # `pop`, the frames after it have not. `take_seen` removes the last frame before `_seen` out of turn.

    def _move_search(self, popped: int) -> None:
        """Adjust the offsets after the first frame, of this length, was removed."""
        self._seen = max(0, self._seen - popped)
        self._searched = max(0, self._searched - popped)
        self.ahead = max(0, self.ahead - 1)

    def may_hold(self, word: bytes) -> bool:
        """Return True if ``word`` occurs in a complete frame not looked at yet, or in the bytes after it.

        Args:
            word: The bytes to find, the same in every call: no byte is searched twice.
        """
        if self._unseen_end() is None:
            return False
        at = self._buffer.find(word, max(self._seen, self._searched))
        self._searched = max(0, len(self._buffer) - len(word) + 1) if at < 0 else at
        return at >= 0

    def look_ahead(self) -> bytes | None:
        """Return the next complete payload not looked at yet, without removing it; None if there is none.

        A frame with a length that is not accepted ends the search; ``pop`` raises its error.
        """
        end = self._unseen_end()
        if end is None:
            return None
        begin, self._seen = self._seen + HEADER, end
        self.ahead += 1
        return bytes(memoryview(self._buffer)[begin:end])

    def _unseen_end(self) -> int | None:
        begin = self._seen + HEADER
        length = int.from_bytes(self._buffer[self._seen : begin], "big")
        end = begin + length
        return end if 0 < length <= self.limit and end <= len(self._buffer) else None

    def take_seen(self, length: int) -> None:
        """Remove the payload, of this length, that ``look_ahead`` returned last; ``pop`` skips it."""
        begin = self._seen - HEADER - length
        del self._buffer[begin : self._seen]
        self._seen = self._searched = begin
        self.ahead -= 1
        if not begin:
            self._needed = HEADER

    def _check(self, length: int) -> None:
        if not 0 < length <= self.limit:
            self._buffer.clear()
            self._error = FrameError(length, self.limit)
            raise self._error
