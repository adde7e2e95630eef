"""Selection of the one valid reply of a cycle among the received datagrams."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

from armgate.emulator.krc.errors import Fault, ReplyError
from armgate.emulator.krc.log import EventLog
from armgate.emulator.krc.rsi.ipoc import Ipoc
from armgate.emulator.krc.rsi.reply import Reply, ReplyParser


@dataclass(frozen=True, slots=True)
class Arrival:
    """Received datagram.

    Attributes:
        data: Content.
        age: Time between the last telegram and the datagram, s.
        stranger: Its source, if that is not the PC to which telegrams are sent.
    """

    data: bytes
    age: float
    stranger: str | None = None


class ReplyFilter:
    """Filter that accepts the first valid reply in time, and counts and logs rejected datagrams.

    Args:
        parser: Parser of replies.
        within: Time after the telegram until which a reply is accepted, s.
        log: Log for rejections.
    """

    def __init__(self, parser: ReplyParser, within: float, log: EventLog) -> None:
        self._parser = parser
        self._within = within
        self._log = log
        self.rejected: Counter[Fault] = Counter()
        """Rejected datagrams by reason, since the start of the process."""

    def select(self, arrivals: Iterable[Arrival], ipoc: Ipoc) -> Reply | None:
        """Return the reply to the last telegram: the first one that is valid and in time."""
        accepted: Reply | None = None
        for arrival in arrivals:
            try:
                reply = self._check(arrival, ipoc)
                if accepted is not None:
                    raise ReplyError(
                        Fault.DOUBLE, f"a second reply to IPOC {reply.ipoc}; only the first is used"
                    )
                accepted = reply
            except ReplyError as error:
                self.rejected[error.fault] += 1
                count = self.rejected[error.fault]
                self._log.repeated("rejected", count, f"{error}", fault=error.fault.value)
        return accepted

    def _check(self, arrival: Arrival, ipoc: Ipoc) -> Reply:
        if arrival.stranger is not None:
            raise ReplyError(Fault.STRANGER, f"from {arrival.stranger}, which is not the PC; ignored")
        reply = self._parser.parse(arrival.data)
        age = ipoc.age(reply.ipoc)
        if age is None:
            raise ReplyError(
                Fault.WRONG_IPOC,
                f"IPOC {reply.ipoc} was not sent recently; expected {ipoc.last}, echoed unchanged",
            )
        if age > 0:
            raise ReplyError(Fault.LATE, f"replies to IPOC {reply.ipoc}, {age} telegram(s) ago; too late")
        if arrival.age > self._within:
            took = f"came {1000 * arrival.age:.1f} ms after IPOC {reply.ipoc}"
            raise ReplyError(Fault.LATE, f"{took}; expected it within {1000 * self._within:g} ms")
        return reply
