"""Correlation of received messages with sent ones: answers by id, verdicts by ``seq``, unawaited errors."""

from collections import deque
from typing import TypeVar

from armgate.client.errors import ConnectionLost, Refused
from armgate.protocol import ErrorCode
from armgate.protocol.messages import Answer, Error, Verdict

KEPT_VERDICTS = 4096
"""Number of verdicts on posted commands that are kept per robot; older ones are dropped."""

A = TypeVar("A", bound=Answer)


class Pending:
    """Messages that await an answer.

    Attributes:
        signals_dropped: Number of signals that the server dropped because they arrived too fast.
    """

    def __init__(self) -> None:
        self.signals_dropped = 0
        self._answers: dict[int, Answer | None] = {}
        self._verdicts: dict[int, Verdict | Refused | None] = {}
        self._posted: dict[str, deque[Verdict]] = {}
        self._signals: set[int] = set()
        self._signal_refused: Refused | None = None
        self._unawaited: Refused | None = None

    # --- sent messages -------------------------------------------------------------------------------------

    def expect_answer(self, number: int) -> None:
        """Expect the answer with this ``re``."""
        self._answers[number] = None

    def expect_verdict(self, seq: int) -> None:
        """Expect the verdict on this command; other verdicts are kept for ``verdicts``."""
        self._verdicts[seq] = None

    def expect_signaled(self, number: int) -> None:
        """Expect the answer to a signal, without a call that waits for it."""
        self._signals.add(number)

    def forget_answer(self, number: int) -> None:
        """Stop waiting for an answer."""
        self._answers.pop(number, None)

    def forget_verdict(self, seq: int) -> None:
        """Stop waiting for a verdict."""
        self._verdicts.pop(seq, None)

    # --- results -------------------------------------------------------------------------------------------

    def answer(self, number: int, kind: type[A]) -> A | None:
        """Return the answer to a request, once; None until it has arrived.

        Raises:
            Refused: The server answered with an error.
            ConnectionLost: The server answered with a message of another type.
        """
        found = self._answers.get(number)
        if found is None:
            return None
        del self._answers[number]
        if isinstance(found, Error):
            raise Refused(found)
        if not isinstance(found, kind):
            raise ConnectionLost(f"the server answered with {found.type}; expected {kind.__name__}")
        return found

    def verdict(self, seq: int) -> Verdict | None:
        """Return the verdict on a command that is waited for, once; None until it has arrived.

        Raises:
            Refused: The command could not be read, so it has no verdict.
        """
        found = self._verdicts.get(seq)
        if found is None:
            return None
        del self._verdicts[seq]
        if isinstance(found, Refused):
            raise found
        return found

    def verdicts(self, robot: str) -> list[Verdict]:
        """Return the verdicts on a robot's posted commands since the last call, in order."""
        return list(self._posted.pop(robot, ()))

    def raise_unawaited(self) -> None:
        """Raise, once, a refusal that no call waited for."""
        refused, self._unawaited = self._unawaited, None
        if refused is not None:
            raise refused

    def raise_refused_signal(self) -> None:
        """Raise, once, the refusal of an earlier signal."""
        refused, self._signal_refused = self._signal_refused, None
        if refused is not None:
            raise refused

    # --- received messages ---------------------------------------------------------------------------------

    def take_answer(self, answer: Answer) -> None:
        """Record a message with a ``re``."""
        if answer.re in self._signals:
            self._signals.discard(answer.re)
        if answer.re in self._answers:
            self._answers[answer.re] = answer

    def take_verdict(self, verdict: Verdict) -> None:
        """Record a verdict."""
        if verdict.seq in self._verdicts:
            self._verdicts[verdict.seq] = verdict
        else:
            self._posted.setdefault(verdict.robot, deque(maxlen=KEPT_VERDICTS)).append(verdict)

    def take_error(self, error: Error) -> None:
        """Record an error that is not fatal; ``take_answer`` handles the answer to a request."""
        if error.re in self._signals:
            self._take_signal_error(error)
        elif error.seq in self._verdicts:
            self._verdicts[error.seq] = Refused(error)
        elif error.re not in self._answers:
            self._unawaited = Refused(error)

    def _take_signal_error(self, error: Error) -> None:
        # A signal that is dropped for its rate must not end a control loop: it only informs other clients.
        if error.code == ErrorCode.SIGNAL_RATE:
            self.signals_dropped += 1
        else:
            self._signal_refused = Refused(error)
