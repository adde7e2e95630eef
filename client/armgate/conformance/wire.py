"""One connection of the kit: what is sent, what is heard, and whether it is formed as it should be."""

import asyncio
import socket
import struct
from collections import Counter, deque
from collections.abc import Callable, Iterable
from itertools import count
from typing import Any

from armgate.conformance.forms import MESSAGES, faults
from armgate.conformance.ledger import Account, Ledger
from armgate.conformance.log import WireLog
from armgate.conformance.packing import Cutter, Fields, Malformed, pack, unpack
from armgate.conformance.verdicts import Unmet

_REPEATED = 8
"""Faults of one connection that are told: a server that is wrong once often is so all the time."""


class Wire(asyncio.Protocol):
    """A client's connection.

    Args:
        name: Whose it is, for the log.
        log: Where its bytes are noted.
        ledger: Where its commands and their verdicts are noted.
        patience: How long an answer may take, s.

    Attributes:
        faults: What was wrong with what the server sent, whatever the case is about.
        inbox: Messages that nobody has taken yet.
        ended: Whether the server has closed.
        lost: The exception with which the connection broke, if it did.
        welcome: The server's welcome, empty before.
    """

    def __init__(self, name: str, log: WireLog, ledger: Ledger, patience: float) -> None:
        self.name = name
        self.faults: list[str] = []
        self.inbox: deque[Fields] = deque()
        self.ended = False
        self.lost: Exception | None = None
        self.welcome: Fields = {}
        self.patience = patience
        self.account = Account(ledger)
        self.ledger = ledger
        self._log = log
        self._cutter = Cutter()
        self._news = asyncio.Event()
        self._asked: Counter[int] = Counter()
        self._ids = count(1)
        self._over = ""
        self._said_all = False
        self._transport: asyncio.Transport

    # --- asyncio ------------------------------------------------------------------------------------------

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Connected."""
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        self._log.add(self.name, "·", b"", "connected")

    def data_received(self, data: bytes) -> None:
        """The server sent bytes."""
        try:
            payloads = self._cutter.feed(data)
        except Malformed as error:
            self._log.add(self.name, "←", data, str(error))
            self._fault(str(error))
            self._transport.abort()
            return
        for payload in payloads:
            self._take(payload)
        self._news.set()

    def eof_received(self) -> None:
        """The server sends no more: close this side too."""
        self.ended = True
        if self._cutter.left:
            self._fault(f"the server closed within a frame, after {self._cutter.left} bytes of it")
        self._log.add(self.name, "·", b"", "the server sends no more")
        self._news.set()

    def connection_lost(self, exc: Exception | None) -> None:
        """Closed by either side."""
        self._log.add(self.name, "·", b"", f"closed{'' if exc is None else f': {exc}'}")
        self.ended, self.lost = True, exc
        self._news.set()

    @property
    def alive(self) -> bool:
        """Whether both sides may still speak."""
        return not (self.ended or self._over or self._said_all or self._transport.is_closing())

    # --- saying -------------------------------------------------------------------------------------------

    def write(self, data: bytes, meaning: str = "bytes") -> None:
        """Send bytes as they are."""
        self._log.add(self.name, "→", data, meaning)
        self._transport.write(data)

    def say(self, *messages: Fields) -> None:
        """Send messages, all in one write."""
        for message in messages:
            self.note(message)
            shown = message | {"token": "…"} if "token" in message else message
            self._log.add(self.name, "→", pack(shown), shown)
        self._transport.write(b"".join(map(pack, messages)))

    def note(self, message: Fields) -> None:
        """Count on the answer to a message that is sent as bytes."""
        self.account.said(message)
        self._said_all |= message.get("type") == "bye"
        if type(message.get("id")) is int:
            self._asked[message["id"]] += 1

    def say_in_pieces(self, pieces: Iterable[bytes], meaning: str) -> None:
        """Send bytes piece by piece, each in a packet of its own as far as that is in our hands."""
        sock = self._transport.get_extra_info("socket")
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        for piece in pieces:
            self.write(piece, meaning)

    def half_close(self) -> None:
        """Send no more, but read on."""
        self._log.add(self.name, "·", b"", "half-closed by the kit")
        self._said_all = True
        self._transport.write_eof()

    def can_half_close(self) -> bool:
        """Whether the transport knows half-closed connections (TLS does not)."""
        return self._transport.can_write_eof()

    def reset(self) -> None:
        """Break the connection off with a TCP reset."""
        sock = self._transport.get_extra_info("socket")
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        self._log.add(self.name, "·", b"", "reset by the kit")
        self._transport.abort()

    def close(self) -> None:
        """Close without a word."""
        self._transport.close()

    def say_quietly(self, *messages: Fields) -> None:
        """Send many messages of which only the number is noted."""
        self._log.add(self.name, "→", b"", f"{len(messages)} times {messages[0]}")
        self._transport.write(b"".join(map(pack, messages)))

    def small_buffer(self) -> None:
        """Let the kernel keep little of what this side does not read."""
        sock = self._transport.get_extra_info("socket")
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)

    def deaf(self, deaf: bool) -> None:
        """Read no more, or again."""
        if not self._transport.is_closing():
            (self._transport.pause_reading if deaf else self._transport.resume_reading)()

    # --- hearing ------------------------------------------------------------------------------------------

    async def hear(self, wanted: Callable[[Fields], bool], what: str, within: float | None = None) -> Fields:
        """The next message that is wanted; others before it are dropped.

        Raises:
            Unmet: The connection ended, or nothing came in time.
        """
        patience = self.patience if within is None else within
        try:
            async with asyncio.timeout(patience):
                while True:
                    while self.inbox:
                        message = self.inbox.popleft()
                        if wanted(message):
                            return message
                    if self.ended:
                        raise Unmet(f"{self.name}: expected {what}, but the server closed the connection")
                    await self._wait()
        except TimeoutError:
            raise Unmet(f"{self.name}: expected {what}, but nothing came within {patience:g} s") from None

    async def expect(self, *kinds: str, within: float | None = None, **fields: Any) -> Fields:
        """The next message that is not told to all; it must be of one of these kinds, with these fields.

        Raises:
            Unmet: It is another one, or none comes.
        """
        what = " or ".join(kinds) + (f" with {fields}" if fields else "")

        def counts(message: Fields) -> bool:
            return message["type"] in kinds or (message["type"] in MESSAGES and not _told_to_all(message))

        message = await self.hear(counts, what, within)
        differing = {key: message.get(key) for key, value in fields.items() if message.get(key) != value}
        if message["type"] not in kinds or differing:
            raise Unmet(f"{self.name}: expected {what}, got {_brief(message)}")
        return message

    async def ends(self, within: float | None = None) -> list[Fields]:
        """All messages until the server closes.

        Raises:
            Unmet: It does not close in time.
        """
        patience = self.patience if within is None else within
        try:
            async with asyncio.timeout(patience):
                while not self.ended:
                    await self._wait()
        except TimeoutError:
            raise Unmet(
                f"{self.name}: expected that the server closes; after {patience:g} s it had not"
            ) from None
        found = list(self.inbox)
        self.inbox.clear()
        return found

    async def fails(self, *codes: str, within: float | None = None) -> Fields:
        """The fatal error with which the server closes.

        Raises:
            Unmet: There is none as the last message, it has another code, or the connection stays.
        """
        found = await self.ends(within)
        last = found[-1] if found else {"type": "nothing"}
        if last["type"] != "error" or last["fatal"] is not True or last["code"] not in codes:
            raise Unmet(f"{self.name}: expected a fatal {' or '.join(codes)}, got {_brief(last)}")
        return last

    async def ask(self, kind: str, **fields: Any) -> Fields:
        """Send a request; the answer, whatever it is, with our id as its ``re``."""
        number = next(self._ids)
        self.say({"type": kind, "id": number, **fields})
        return await self.answer_to(number)

    async def answer_to(self, number: int) -> Fields:
        """The answer to the request with this id, whatever it is."""
        return await self.hear(lambda m: m.get("re") == number, f"the answer to request {number}")

    async def answered(self, kind: str, by: str, **fields: Any) -> Fields:
        """Send a request that must be answered by a message of one kind.

        Raises:
            Unmet: It is answered otherwise, or not.
        """
        answer = await self.ask(kind, **fields)
        if answer["type"] != by:
            raise Unmet(f"{self.name}: {kind} should be answered by {by}, not by {_brief(answer)}")
        return answer

    async def refused(self, kind: str, code: str, **fields: Any) -> Fields:
        """Send a request that must be answered by an error that is not fatal.

        Raises:
            Unmet: It is answered otherwise, or not.
        """
        answer = await self.ask(kind, **fields)
        if answer["type"] != "error" or answer["code"] != code or answer["fatal"] is not False:
            raise Unmet(f"{self.name}: {kind} should be refused as {code}, not fatal; got {_brief(answer)}")
        return answer

    async def heard(self) -> list[Fields]:
        """All messages before the pong of a ping sent now."""
        found: list[Fields] = []
        self.say({"type": "ping", "time": 7.0})
        while (message := await self.hear(lambda m: True, "pong"))["type"] != "pong":
            found.append(message)
        return found

    async def in_step(self) -> None:
        """Wait until all that was said before has been answered: messages are done in their order.

        Raises:
            Unmet: A command has no answer by then.
        """
        await self.answered("ping", "pong", time=0.0)

    async def _wait(self) -> None:
        self._news.clear()
        await self._news.wait()

    def _take(self, payload: bytes) -> None:
        try:
            message = unpack(payload)
        except Malformed as error:
            self._log.add(self.name, "←", payload, str(error))
            self._fault(str(error))
            return
        self._log.add(self.name, "←", payload, message)
        wrong = list(faults(message))
        for fault in wrong or self._misplaced(message):
            self._fault(fault)
        if not wrong and message.get("type") in MESSAGES:
            for fault in self.account.heard(message):
                self._fault(fault)
            self.inbox.append(message)

    def _misplaced(self, message: Fields) -> Iterable[str]:
        kind = message["type"]
        if self._over:
            yield f"{kind} after the server's {self._over}, which is the last that it says"
        if kind == "welcome":
            if self.welcome:
                yield "a second welcome"
            self.welcome = message
        elif not self.welcome and kind not in ("error", "bye"):
            yield f"{kind} before welcome"
        if kind == "bye" or (kind == "error" and message["fatal"]):
            self._over = kind
        number = message.get("re")
        if number is not None and kind != "state" and self._asked[number] < 1:
            yield f"{kind} answers request {number}, which was never made or is answered already"
        if number is not None:
            self._asked[number] -= 1

    def _fault(self, text: str) -> None:
        if len(self.faults) < _REPEATED:
            self.faults.append(f"{self.name}: {text}")


def _told_to_all(message: Fields) -> bool:
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
