"""One connection of the kit: sends messages, receives and validates those of the server."""

import asyncio
import socket
import struct
from collections import Counter, deque
from collections.abc import Callable, Iterable
from itertools import count
from typing import Any

from armgate.conformance.case import Violation
from armgate.conformance.codec import Fields, FrameReader, Malformed, pack, unpack
from armgate.conformance.command_log import CommandLog, VerdictTracker
from armgate.conformance.message_schema import MESSAGES, schema_errors
from armgate.conformance.wire_log import WireLog

_MOST_VIOLATIONS = 8
"""Number of violations that are kept of one connection: a server often repeats the same error."""


class Connection(asyncio.Protocol):
    """Connection of a client.

    Args:
        name: Name of the client, for the log.
        log: Log of the bytes.
        commands: Log of the commands and their verdicts.
        timeout: Longest time until an answer, s.

    Attributes:
        violations: Errors in the server's messages, independent of the case.
        inbox: Messages that were received and not yet consumed.
        ended: True if the server has closed the connection.
        lost: The exception that broke the connection, or None.
        welcome: The server's welcome; empty before it comes.
    """

    def __init__(self, name: str, log: WireLog, commands: CommandLog, timeout: float) -> None:
        self.name = name
        self.violations: list[str] = []
        self.inbox: deque[Fields] = deque()
        self.ended = False
        self.lost: Exception | None = None
        self.welcome: Fields = {}
        self.timeout = timeout
        self.verdicts = VerdictTracker(commands)
        self.commands = commands
        self._log = log
        self._frames = FrameReader()
        self._news = asyncio.Event()
        self._open_requests: Counter[int] = Counter()
        self._ids = count(1)
        self._last_of_server = ""
        self._done_sending = False
        self._transport: asyncio.Transport

    # --- asyncio ------------------------------------------------------------------------------------------

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Keep the transport."""
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        self._log.add(self.name, "·", b"", "connected")

    def data_received(self, data: bytes) -> None:
        """Decode the server's bytes into messages for the inbox."""
        try:
            payloads = self._frames.feed(data)
        except Malformed as error:
            self._log.add(self.name, "←", data, str(error))
            self._add_violation(str(error))
            self._transport.abort()
            return
        for payload in payloads:
            self._process(payload)
        self._news.set()

    def eof_received(self) -> None:
        """Close this side too: the server sends no more."""
        self.ended = True
        if self._frames.pending:
            self._add_violation(f"the server closed within a frame, after {self._frames.pending} bytes of it")
        self._log.add(self.name, "·", b"", "the server sends no more")
        self._news.set()

    def connection_lost(self, exc: Exception | None) -> None:
        """Note that either side has closed the connection."""
        self._log.add(self.name, "·", b"", f"closed{'' if exc is None else f': {exc}'}")
        self.ended, self.lost = True, exc
        self._news.set()

    @property
    def alive(self) -> bool:
        """True if both sides may still send."""
        closed = self.ended or self._transport.is_closing()
        return not (closed or self._last_of_server or self._done_sending)

    # --- sending ------------------------------------------------------------------------------------------

    def send_bytes(self, data: bytes, meaning: str = "bytes") -> None:
        """Send bytes unchanged."""
        self._log.add(self.name, "→", data, meaning)
        self._transport.write(data)

    def send(self, *messages: Fields) -> None:
        """Send messages, all in one write."""
        for message in messages:
            self.register(message)
            shown = message | {"token": "…"} if "token" in message else message
            self._log.add(self.name, "→", pack(shown), shown)
        self._transport.write(b"".join(map(pack, messages)))

    def register(self, message: Fields) -> None:
        """Expect the answer to a message that is sent as bytes."""
        self.verdicts.note_sent(message)
        self._done_sending |= message.get("type") == "bye"
        if type(message.get("id")) is int:
            self._open_requests[message["id"]] += 1

    def send_in_pieces(self, pieces: Iterable[bytes], meaning: str) -> None:
        """Send bytes piece by piece, each in a packet of its own as far as the kit can control it."""
        sock = self._transport.get_extra_info("socket")
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        for piece in pieces:
            self.send_bytes(piece, meaning)

    def send_unlogged(self, *messages: Fields) -> None:
        """Send many messages, and log only their number."""
        self._log.add(self.name, "→", b"", f"{len(messages)} times {messages[0]}")
        self._transport.write(b"".join(map(pack, messages)))

    def half_close(self) -> None:
        """Close the sending direction and continue to read."""
        self._log.add(self.name, "·", b"", "half-closed by the kit")
        self._done_sending = True
        self._transport.write_eof()

    def can_half_close(self) -> bool:
        """Return True if the transport supports half-closed connections (TLS does not)."""
        return self._transport.can_write_eof()

    def reset(self) -> None:
        """Abort the connection with a TCP reset."""
        sock = self._transport.get_extra_info("socket")
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        self._log.add(self.name, "·", b"", "reset by the kit")
        self._transport.abort()

    def close(self) -> None:
        """Close the connection without ``bye``."""
        self._transport.close()

    # --- receiving ----------------------------------------------------------------------------------------

    def shrink_receive_buffer(self) -> None:
        """Shrink the kernel's receive buffer, so that unread bytes soon fill it."""
        sock = self._transport.get_extra_info("socket")
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)

    def pause_reading(self) -> None:
        """Stop reading from the socket."""
        if not self._transport.is_closing():
            self._transport.pause_reading()

    def resume_reading(self) -> None:
        """Read from the socket again."""
        if not self._transport.is_closing():
            self._transport.resume_reading()

    async def receive(
        self, wanted: Callable[[Fields], bool], what: str, within: float | None = None
    ) -> Fields:
        """Return the next wanted message; drop those before it.

        Args:
            wanted: Returns True for a message that is wanted.
            what: Its name, for the error.
            within: Longest time to wait, s; by default the timeout of an answer.

        Raises:
            Violation: The connection ended, or no such message came in time.
        """
        seconds = self.timeout if within is None else within
        try:
            async with asyncio.timeout(seconds):
                while True:
                    while self.inbox:
                        message = self.inbox.popleft()
                        if wanted(message):
                            return message
                    if self.ended:
                        raise Violation(f"{self.name}: expected {what}, but the server closed the connection")
                    await self._wait()
        except TimeoutError:
            raise Violation(f"{self.name}: expected {what}, but nothing came within {seconds:g} s") from None

    async def expect(self, *kinds: str, **fields: Any) -> Fields:
        """Return the next message that is not a broadcast; it must have one of these types and these fields.

        Raises:
            Violation: Another message comes, or none.
        """
        what = " or ".join(kinds) + (f" with {fields}" if fields else "")

        def counts(message: Fields) -> bool:
            return message["type"] in kinds or (message["type"] in MESSAGES and not _is_broadcast(message))

        message = await self.receive(counts, what)
        differing = {key: message.get(key) for key, value in fields.items() if message.get(key) != value}
        if message["type"] not in kinds or differing:
            raise Violation(f"{self.name}: expected {what}, got {_brief(message)}")
        return message

    async def receive_until_closed(self, within: float | None = None) -> list[Fields]:
        """Return all messages until the server closes the connection.

        Raises:
            Violation: It does not close in time.
        """
        seconds = self.timeout if within is None else within
        try:
            async with asyncio.timeout(seconds):
                while not self.ended:
                    await self._wait()
        except TimeoutError:
            text = f"expected the server to close the connection within {seconds:g} s"
            raise Violation(f"{self.name}: {text}") from None
        found = list(self.inbox)
        self.inbox.clear()
        return found

    async def expect_fatal(self, *codes: str, within: float | None = None) -> Fields:
        """Return the fatal error with which the server closes the connection.

        Raises:
            Violation: The last message is not such an error, or the connection stays open.
        """
        found = await self.receive_until_closed(within)
        last = found[-1] if found else {"type": "nothing"}
        if last["type"] != "error" or last["fatal"] is not True or last["code"] not in codes:
            raise Violation(f"{self.name}: expected a fatal error {' or '.join(codes)}, got {_brief(last)}")
        return last

    async def request(self, kind: str, **fields: Any) -> Fields:
        """Send a request and return its answer of any type, whose ``re`` is the id of the request."""
        number = next(self._ids)
        self.send({"type": kind, "id": number, **fields})
        return await self.answer_to(number)

    async def answer_to(self, number: int) -> Fields:
        """Return the answer of any type to the request with this id."""
        return await self.receive(lambda m: m.get("re") == number, f"the answer to request {number}")

    async def call(self, kind: str, answer_kind: str, **fields: Any) -> Fields:
        """Send a request and return its answer, which must be of one type.

        Raises:
            Violation: Another answer comes, or none.
        """
        answer = await self.request(kind, **fields)
        if answer["type"] != answer_kind:
            raise Violation(f"{self.name}: {kind}: expected {answer_kind}, got {_brief(answer)}")
        return answer

    async def expect_refusal(self, kind: str, code: str, **fields: Any) -> Fields:
        """Send a request and return its answer, which must be an error that is not fatal.

        Raises:
            Violation: Another answer comes, or none.
        """
        answer = await self.request(kind, **fields)
        if answer["type"] != "error" or answer["code"] != code or answer["fatal"] is not False:
            raise Violation(
                f"{self.name}: {kind}: expected an error {code} that is not fatal, got {_brief(answer)}"
            )
        return answer

    async def drain(self) -> list[Fields]:
        """Return all messages that come before the pong of a ping sent now."""
        found: list[Fields] = []
        self.send({"type": "ping", "time": 7.0})
        while (message := await self.receive(lambda m: True, "pong"))["type"] != "pong":
            found.append(message)
        return found

    async def sync(self) -> None:
        """Wait until the server has processed all earlier messages: it answers a ping after them.

        Raises:
            Violation: The ping is not answered by a pong.
        """
        await self.call("ping", "pong", time=0.0)

    async def _wait(self) -> None:
        self._news.clear()
        await self._news.wait()

    # --- validation ---------------------------------------------------------------------------------------

    def _process(self, payload: bytes) -> None:
        try:
            message = unpack(payload)
        except Malformed as error:
            self._log.add(self.name, "←", payload, str(error))
            self._add_violation(str(error))
            return
        self._log.add(self.name, "←", payload, message)
        wrong = list(schema_errors(message))
        for text in wrong or self._sequence_errors(message):
            self._add_violation(text)
        if not wrong and message.get("type") in MESSAGES:
            for text in self.verdicts.note_received(message):
                self._add_violation(text)
            self.inbox.append(message)

    # A server's side of a conversation has three phases: only error or bye before welcome, anything but a
    # second welcome after it, and nothing after bye or a fatal error. An answer (``re``) belongs to exactly
    # one open request; states are not answers, so they are exempt.

    def _sequence_errors(self, message: Fields) -> Iterable[str]:
        """Yield the errors of a message that is well-formed but must not come here."""
        kind = message["type"]
        if self._last_of_server:
            yield f"{kind} after the server's {self._last_of_server}, which must be its last message"
        if kind == "welcome":
            if self.welcome:
                yield "a second welcome"
            self.welcome = message
        elif not self.welcome and kind not in ("error", "bye"):
            yield f"{kind} before welcome"
        if kind == "bye" or (kind == "error" and message["fatal"]):
            self._last_of_server = kind
        number = message.get("re")
        if number is not None and kind != "state" and self._open_requests[number] < 1:
            yield f"{kind} answers request {number}, which was never sent or was already answered"
        if number is not None:
            self._open_requests[number] -= 1

    def _add_violation(self, text: str) -> None:
        if len(self.violations) < _MOST_VIOLATIONS:
            self.violations.append(f"{self.name}: {text}")


def _is_broadcast(message: Fields) -> bool:
    kind = message["type"]
    if kind == "lease":
        return message.get("re") is None and message["state"] == "lost"
    return kind == "state" or (kind in ("stopped", "resumed") and message.get("re") is None)


def _brief(message: Fields) -> str:
    kind = message.get("type")
    if kind == "error":
        fatal = "fatal " if message.get("fatal") else ""
        return f"{fatal}error {message.get('code')} ({message.get('text')})"
    text = repr({key: value for key, value in message.items() if key != "type"})
    return f"{kind} {text if len(text) < 240 else text[:240] + '…'}"
