"""What a controller can meet, one exception each; every text says what happened and what to do.

::

    ClientError
    ├── BadArgument       a value given to the SDK has no sense (also a ValueError)
    ├── ConnectionLost    there is no connection (any more): connect again, nothing does it by itself
    │   └── Rejected      the server ended it with a fatal error; ``code`` says why
    ├── TimedOut          no answer in time; the connection is still there
    ├── Refused           the server did not do what was asked; ``code`` says why
    └── Lost              the robot is no longer this client's; it brakes to rest along its plan
        ├── LeaseLost     the lease expired, was taken over or given back: acquire the robot again
        └── RobotStopped  a stop is in force: an operator resets it, then acquire the robot again

Codes are those of ``armgate.protocol.ErrorCode``.
"""

from armgate.protocol import CODES, ErrorCode
from armgate.protocol.messages import Error, Stopped


class ClientError(Exception):
    """Whatever goes wrong between a controller and its cell."""


class BadArgument(ClientError, ValueError):  # noqa: N818
    """A value given to the SDK has no sense; nothing was sent."""


class ConnectionLost(ClientError):  # noqa: N818
    """There is no connection (any more)."""


class Rejected(ConnectionLost):
    """The server ended the connection.

    Attributes:
        code: Why, see ``armgate.protocol.CODES``.
    """

    def __init__(self, error: Error) -> None:
        super().__init__(f"the server ended the connection: {_told(error)}")
        self.code = error.code


class TimedOut(ClientError):  # noqa: N818
    """No answer in time; a late one is dropped."""


class Refused(ClientError):  # noqa: N818
    """The server did not do what was asked.

    Attributes:
        code: Why, see ``armgate.protocol.CODES``.
        about: The type of the message meant.
        seq: The command meant, None for other messages.
    """

    def __init__(self, error: Error) -> None:
        about = error.about or "a message"
        super().__init__(f"{about} was refused: {_told(error)}")
        self.code = error.code
        self.about = error.about
        self.seq = error.seq


class Lost(ClientError):  # noqa: N818
    """The robot is no longer this client's; it brakes to rest along the plan that it holds.

    Attributes:
        robot: Its name.
        reason: Why.
    """

    def __init__(self, text: str, robot: str, reason: str) -> None:
        super().__init__(text)
        self.robot = robot
        self.reason = reason


class LeaseLost(Lost):
    """The lease ended: it expired, was taken over, or was given back."""

    def __init__(self, robot: str, reason: str) -> None:
        text = f"the lease of {robot} is lost ({reason}); the robot comes to rest; acquire it again to go on"
        super().__init__(text, robot, reason)


class RobotStopped(Lost):
    """A stop is in force.

    Attributes:
        stop: The stop's id, which a reset names.
        by: Who stopped.
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


def _told(error: Error) -> str:
    known = error.code in ErrorCode.__members__.values()
    advice = f"; {CODES[ErrorCode(error.code)].advice}" if known else ""
    return f"{error.code}: {error.text}{advice}"
