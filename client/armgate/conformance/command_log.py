"""Log of the commands of a run and of their verdicts, over all connections of the kit."""

from collections import defaultdict, deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import count

from armgate.conformance.codec import Fields

Key = tuple[str, int]
"""Robot and sequence number of a command."""


@dataclass
class CommandLog:
    """Commands that were sent, and their verdicts.

    Attributes:
        sent: The commands by robot and seq.
        verdicts: Their verdicts.
        forbidden: Commands that no robot may execute, whatever their verdicts are, with the reason.
        seqs: Iterator that gives every command of a run its own seq.
    """

    seqs: Iterator[int] = field(default_factory=lambda: count(1))
    sent: dict[Key, Fields] = field(default_factory=dict)
    verdicts: dict[Key, Fields] = field(default_factory=dict)
    forbidden: dict[Key, str] = field(default_factory=dict)

    def number_after(self, seq: int) -> None:
        """Give the next command a larger seq than ``seq`` and than all commands of the run."""
        self.seqs = count(max(seq, next(self.seqs)) + 1)

    def forbid(self, command: Fields, why: str) -> Fields:
        """Note that no robot may execute this command, and return it."""
        self.forbidden[command["robot"], command["seq"]] = why
        return command


class VerdictTracker:
    """Checker of one connection's commands: each must be answered once, in order, before it is applied."""

    def __init__(self, log: CommandLog) -> None:
        self._log = log
        self._waiting: dict[str, deque[int]] = defaultdict(deque)
        self._answered: set[Key] = set()
        self._ticks: dict[str, int] = {}

    @property
    def used(self) -> bool:
        """True if any command was sent."""
        return bool(self._waiting)

    @property
    def unanswered(self) -> list[Key]:
        """Commands without a verdict or an error."""
        return [(robot, seq) for robot, seqs in self._waiting.items() for seq in seqs]

    def note_sent(self, message: Fields) -> None:
        """Note a message to the server; only commands count."""
        robot, seq = message.get("robot"), message.get("seq")
        if message.get("type") == "command" and isinstance(robot, str) and type(seq) is int:
            self._waiting[robot].append(seq)
            self._log.sent[robot, seq] = message

    def note_received(self, message: Fields) -> Iterator[str]:
        """Note a message from the server, and yield its violations of the order of answers."""
        match message.get("type"):
            case "verdict":
                yield from self._verdict(message)
            case "error":
                self._error(message)
            case "state":
                yield from self._state(message)

    # A connection's commands for one robot are answered in the order in which they were sent, each by exactly
    # one verdict, or by an error if it was unreadable. So a queue of open sequence numbers per robot
    # suffices: the verdict of its head is in order, that of a later entry is early, and any other one is a
    # second answer or belongs to no command. A state must not apply a command that is still in the queue.

    def _verdict(self, message: Fields) -> Iterator[str]:
        robot, seq = message["robot"], message["seq"]
        waiting = self._waiting[robot]
        if waiting and waiting[0] == seq:
            waiting.popleft()
        elif seq in waiting:
            yield f"the verdict of seq {seq} for {robot} came before that of seq {waiting[0]}"
            waiting.remove(seq)
        elif (robot, seq) in self._answered:
            yield f"a second answer to the command with seq {seq} for {robot}"
        else:
            yield f"a verdict of seq {seq} for {robot}: this connection sent no such command"
        self._answered.add((robot, seq))
        self._log.verdicts.setdefault((robot, seq), message)

    def _error(self, message: Fields) -> None:
        seq = message.get("seq")
        if seq is None:
            return
        for robot, waiting in self._waiting.items():
            if seq in waiting:
                waiting.remove(seq)
                self._answered.add((robot, seq))

    def _state(self, message: Fields) -> Iterator[str]:
        robot, tick = message["robot"], message["tick"]
        if tick < self._ticks.get(robot, -1):
            yield f"the state of tick {tick} of {robot} came after that of tick {self._ticks[robot]}"
        self._ticks[robot] = tick
        for entry in message["entries"]:
            if entry.get("applied_seq") in self._waiting.get(entry["robot"], ()):
                yield (
                    f"the state of tick {tick} of {robot} applies seq {entry['applied_seq']} of "
                    f"{entry['robot']} before its verdict"
                )
