"""Frames: a 4-byte big-endian length, then that many bytes of payload.

``frame(payload) -> bytes`` writes one, :class:`FrameDecoder` cuts a stream into payloads. Limits are checked
on the length alone, before any payload is kept: ``HANDSHAKE_LIMIT`` (to the server, before it has said
welcome), ``INBOUND_LIMIT`` (to the server), ``OUTBOUND_LIMIT`` (to the client).
"""

from armgate.protocol.errors import ErrorCode, RemoteProtocolError

HEADER = 4
HANDSHAKE_LIMIT = 4 * 1024
INBOUND_LIMIT = 64 * 1024
OUTBOUND_LIMIT = 1024 * 1024


def frame(payload: bytes) -> bytes:
    """One frame around ``payload``."""
    return len(payload).to_bytes(HEADER, "big") + payload


class FrameDecoder:
    """Cuts a stream of bytes into payloads; feeding it byte by byte equals feeding it whole.

    Between two calls it keeps less than one frame within the limit. After an error it is of no more use and
    raises the same error again.

    Attributes:
        limit: The longest payload accepted; may be changed between two frames.
        ahead: Number of frames that were looked at ahead and are still to be popped.
    """

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self._buffer = bytearray()
        self._seen = 0  # bytes of whole frames at the buffer's beginning that were looked at ahead
        self._searched = 0  # bytes at the buffer's beginning behind which a word is searched on
        self.ahead = 0
        self._needed = HEADER  # bytes to wait for; more once the length of a frame is read
        self._error: RemoteProtocolError | None = None

    @property
    def buffered(self) -> int:
        """How many bytes of an unfinished frame are kept."""
        return len(self._buffer)

    def feed(self, data: bytes) -> list[bytes]:
        """Takes bytes in and returns all payloads that are now complete.

        Raises:
            RemoteProtocolError: A length is 0 or beyond the limit.
        """
        self.push(data)
        payloads = []
        while (payload := self.pop()) is not None:
            payloads.append(payload)
        return payloads

    def push(self, data: bytes) -> None:
        """Takes bytes in; ``pop`` until it gives None before the next push."""
        if self._error is None:
            self._buffer += data

    def pop(self) -> bytes | None:
        """The next complete payload, None if there is none yet.

        Raises:
            RemoteProtocolError: A length is 0 or beyond the limit.
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
        self._seen = max(0, self._seen - self._needed)
        self._searched = max(0, self._searched - self._needed)
        self.ahead = max(0, self.ahead - 1)
        self._needed = HEADER
        return payload

    def may_hold(self, word: bytes) -> bool:
        """Return True if a complete frame was not looked at yet, and these bytes stand there or behind it.

        Args:
            word: The bytes, always the same ones: what was searched once is not searched again.
        """
        if self._unseen_end() is None:
            return False
        at = self._buffer.find(word, max(self._seen, self._searched))
        self._searched = max(0, len(self._buffer) - len(word) + 1) if at < 0 else at
        return at >= 0

    def look_ahead(self) -> bytes | None:
        """Return the next complete payload that was not looked at yet, and leave it; None if there is none.

        A frame of a length that is not accepted ends the search: ``pop`` will find it.
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
        """Take the payload, of this length, that ``look_ahead`` returned last: ``pop`` will not give it."""
        begin = self._seen - HEADER - length
        del self._buffer[begin : self._seen]
        self._seen = self._searched = begin
        self.ahead -= 1
        if not begin:
            self._needed = HEADER

    def _check(self, length: int) -> None:
        if 0 < length <= self.limit:
            return
        self._buffer.clear()
        if length == 0:
            self._error = RemoteProtocolError(ErrorCode.EMPTY_FRAME, "a frame of length 0")
        else:
            text = f"a frame of {length} bytes; at most {self.limit} are accepted here"
            self._error = RemoteProtocolError(ErrorCode.FRAME_TOO_LARGE, text)
        raise self._error
