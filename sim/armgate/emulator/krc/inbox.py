"""Finds the one reply of a cycle among the datagrams that came, and says why the others are none."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

from armgate.emulator.krc.ipoc import Ipoc
from armgate.emulator.krc.notes import Notes
from armgate.emulator.krc.reply import Fault, Reply, ReplyError, ReplyParser


@dataclass(frozen=True, slots=True)
class Arrival:
    """A datagram as it came.

    Attributes:
        data: Its bytes.
        age: Time since the last telegram was sent, s.
        stranger: Its source, if that is not the PC to which telegrams go.
    """

    data: bytes
    age: float
    stranger: str | None = None


class Inbox:
    """Judges arrivals; counts what it rejects.

    Args:
        parser: Reads replies.
        within: Until when a reply counts, s after its telegram.
        notes: Where rejections are told.
    """

    def __init__(self, parser: ReplyParser, within: float, notes: Notes) -> None:
        self._parser = parser
        self._within = within
        self._notes = notes
        self.rejected: Counter[Fault] = Counter()
        """By kind, since the start of the process."""

    def judge(self, arrivals: Iterable[Arrival], ipoc: Ipoc) -> Reply | None:
        """The reply to the last telegram: the first one that is valid and in time."""
        taken: Reply | None = None
        for arrival in arrivals:
            try:
                reply = self._judge(arrival, ipoc)
                if taken is not None:
                    raise ReplyError(
                        Fault.DOUBLE, f"a second answer to IPOC {reply.ipoc}; the first one counts"
                    )
                taken = reply
            except ReplyError as why:
                self.rejected[why.fault] += 1
                count = self.rejected[why.fault]
                self._notes.often("rejected", count, f"{why}", fault=why.fault.value)
        return taken

    def _judge(self, arrival: Arrival, ipoc: Ipoc) -> Reply:
        if arrival.stranger is not None:
            raise ReplyError(Fault.STRANGER, f"from {arrival.stranger}, which is not the PC; ignored")
        reply = self._parser.parse(arrival.data)
        age = ipoc.age(reply.ipoc)
        if age is None:
            raise ReplyError(
                Fault.WRONG_IPOC,
                f"IPOC {reply.ipoc} was not sent lately; expected {ipoc.last}, echoed unchanged",
            )
        if age > 0:
            raise ReplyError(Fault.LATE, f"answers IPOC {reply.ipoc}, {age} telegram(s) ago; too late")
        if arrival.age > self._within:
            took = f"came {1000 * arrival.age:.1f} ms after IPOC {reply.ipoc}"
            raise ReplyError(Fault.LATE, f"{took}; expected it within {1000 * self._within:g} ms")
        return reply
