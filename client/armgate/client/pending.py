"""What this client waits for: answers by id, verdicts by number, and refusals that nobody waits for."""

from collections import deque
from typing import TypeVar

from armgate.client.errors import ConnectionLost, Refused
from armgate.protocol import ErrorCode
from armgate.protocol.messages import Answer, Error, Verdict

KEPT_VERDICTS = 4096
"""How many verdicts of posted commands are kept per robot until somebody asks; older ones are dropped."""

A = TypeVar("A", bound=Answer)


class Pending:
    """Correlates what comes with what was sent.

    Attributes:
        signals_dropped: How many signals the server dropped because they came too fast.
    """

    def __init__(self) -> None:
        self.signals_dropped = 0
        self._answers: dict[int, Answer | None] = {}
        self._verdicts: dict[int, Verdict | Refused | None] = {}
        self._posted: dict[str, deque[Verdict]] = {}
        self._signals: set[int] = set()
        self._signal_refused: Refused | None = None
        self._complaint: Refused | None = None

    # --- what is expected ----------------------------------------------------------------------------------

    def expect_answer(self, number: int) -> None:
        """The answer with this ``re`` is waited for."""
        self._answers[number] = None

    def expect_verdict(self, seq: int) -> None:
        """The verdict of this command is waited for; others' are kept for ``verdicts``."""
        self._verdicts[seq] = None

    def expect_signaled(self, number: int) -> None:
        """A signal was sent; nobody waits."""
        self._signals.add(number)

    def forget_answer(self, number: int) -> None:
        """Nobody waits any longer."""
        self._answers.pop(number, None)

    def forget_verdict(self, seq: int) -> None:
        """Nobody waits any longer."""
        self._verdicts.pop(seq, None)

    # --- what came -----------------------------------------------------------------------------------------

    def answer(self, number: int, kind: type[A]) -> A | None:
        """The answer to a request, once; None while there is none.

        Raises:
            Refused: The server did not do it.
        """
        found = self._answers.get(number)
        if found is None:
            return None
        del self._answers[number]
        if isinstance(found, Error):
            raise Refused(found)
        if not isinstance(found, kind):
            raise ConnectionLost(f"the server answered with {found.type} where {kind.__name__} was expected")
        return found

    def verdict(self, seq: int) -> Verdict | None:
        """The verdict of a command that is waited for, once; None while there is none.

        Raises:
            Refused: The command could not be read, so that it has no verdict.
        """
        found = self._verdicts.get(seq)
        if found is None:
            return None
        del self._verdicts[seq]
        if isinstance(found, Refused):
            raise found
        return found

    def verdicts(self, robot: str) -> list[Verdict]:
        """The verdicts of the robot's posted commands that came since the last call, in order."""
        return list(self._posted.pop(robot, ()))

    def complain(self) -> None:
        """Raises, once, what was refused without anybody waiting for the answer."""
        complaint, self._complaint = self._complaint, None
        if complaint is not None:
            raise complaint

    def complain_of_signals(self) -> None:
        """Raises, once, the refusal of an earlier signal."""
        refused, self._signal_refused = self._signal_refused, None
        if refused is not None:
            raise refused

    # --- what comes ----------------------------------------------------------------------------------------

    def take_answer(self, answer: Answer) -> None:
        """Any message with a ``re``."""
        if answer.re in self._signals:
            self._signals.discard(answer.re)
        if answer.re in self._answers:
            self._answers[answer.re] = answer

    def take_verdict(self, verdict: Verdict) -> None:
        """A judgement."""
        if verdict.seq in self._verdicts:
            self._verdicts[verdict.seq] = verdict
        else:
            self._posted.setdefault(verdict.robot, deque(maxlen=KEPT_VERDICTS)).append(verdict)

    def take_error(self, error: Error) -> None:
        """An error that is not fatal; the answer to a request is found by ``take_answer``."""
        if error.re in self._signals:
            self._take_signal_error(error)
        elif error.seq in self._verdicts:
            self._verdicts[error.seq] = Refused(error)
        elif error.re not in self._answers:
            self._complaint = Refused(error)

    def _take_signal_error(self, error: Error) -> None:
        # A value for others to look at that came too fast is no reason to end a control loop.
        if error.code == ErrorCode.SIGNAL_RATE:
            self.signals_dropped += 1
        else:
            self._signal_refused = Refused(error)
