"""Exceptions of the SDK; every text states what happened and what to do.

::

    ClientError
    ├── BadArgument       an argument is invalid (also a ValueError)
    ├── ConnectionLost    the connection failed or ended: connect again, the SDK never reconnects
    │   └── Rejected      the server ended it with a fatal error; ``code`` is the reason
    ├── TimedOut          no answer in time; the connection is still open
    ├── Refused           the server refused a request; ``code`` is the reason
    └── Lost              the lease ended; the robot brakes to rest along its plan
        ├── LeaseLost     the lease expired, was taken over or released: acquire the robot again
        └── RobotStopped  a stop is in force: an operator resets it, then acquire the robot again

Codes are those of ``armgate.protocol.ErrorCode``.
"""

from armgate.protocol import CODES, ErrorCode
from armgate.protocol.messages import Error, Stopped


class ClientError(Exception):
    """Base of all exceptions of the SDK."""


class BadArgument(ClientError, ValueError):  # noqa: N818
    """Invalid argument; nothing was sent."""


class ConnectionLost(ClientError):  # noqa: N818
    """Connection that failed or ended."""


class Rejected(ConnectionLost):
    """Connection that the server ended with a fatal error.

    Attributes:
        code: Error code, see ``armgate.protocol.CODES``.
    """

    def __init__(self, error: Error) -> None:
        super().__init__(f"the server ended the connection: {_explained(error)}")
        self.code = error.code


class TimedOut(ClientError):  # noqa: N818
    """Timeout of an answer; a late answer is dropped."""


class Refused(ClientError):  # noqa: N818
    """Refusal of a request or command by the server.

    Attributes:
        code: Error code, see ``armgate.protocol.CODES``.
        about: Type of the refused message.
        seq: Number of the refused command; None for other messages.
    """

    def __init__(self, error: Error) -> None:
        about = error.about or "a message"
        super().__init__(f"{about} was refused: {_explained(error)}")
        self.code = error.code
        self.about = error.about
        self.seq = error.seq


class Lost(ClientError):  # noqa: N818
    """Loss of a robot; it brakes to rest along its plan.

    Attributes:
        robot: Name of the robot.
        reason: Reason of the loss.
    """

    def __init__(self, text: str, robot: str, reason: str) -> None:
        super().__init__(text)
        self.robot = robot
        self.reason = reason


class LeaseLost(Lost):
    """Loss of a lease: it expired, was taken over, or was released."""

    def __init__(self, robot: str, reason: str) -> None:
        text = f"the lease of {robot} ended ({reason}); the robot comes to rest; acquire it again to continue"
        super().__init__(text, robot, reason)


class RobotStopped(Lost):
    """Loss of a robot by a stop.

    Attributes:
        stop: Id of the stop, for ``reset``.
        by: Name of the client that stopped the robot.
    """

    def __init__(self, robot: str, stopped: Stopped) -> None:
        why = stopped.reason or "no reason given"
        text = (
            f"{robot} was stopped by {stopped.by} ({why}); an operator must reset stop {stopped.stop}, "
            "then acquire the robot again"
        )
        super().__init__(text, robot, stopped.reason)
        self.stop = stopped.stop
        self.by = stopped.by


def _explained(error: Error) -> str:
    """Return code, text and remedy; a text of the form "reason; remedy" already contains its own remedy."""
    if ";" in error.text:
        return f"{error.code}: {error.text}"
    known = error.code in ErrorCode.__members__.values()
    advice = f"; {CODES[ErrorCode(error.code)].advice}" if known else ""
    return f"{error.code}: {error.text}{advice}"
