"""What can go wrong on the wire: the exceptions, and the one table of error codes.

Exceptions::

    ProtocolError                 a message or a frame is wrong; carries what an Error message needs
    ├── LocalProtocolError        my own side's fault: may not be sent now, or cannot be encoded
    └── RemoteProtocolError       the peer's fault: should not have sent that

``ErrorCode`` names every code that an :class:`~armgate.protocol.messages.Error` may carry, ``CODES`` says of
each whether the connection ends, what it means and what the peer can do.
"""

import re as regex
from dataclasses import dataclass
from enum import StrEnum

from armgate.protocol.messages import MAX_TEXT, Error

_NAME = regex.compile(r"[A-Za-z0-9_.:/-]{1,64}")


class ErrorCode(StrEnum):
    """The codes of error messages; their meaning is in ``CODES``."""

    # The connection is of no more use.
    FRAME_TOO_LARGE = "frame_too_large"
    EMPTY_FRAME = "empty_frame"
    TRUNCATED = "truncated"
    MALFORMED = "malformed"
    UNEXPECTED = "unexpected"
    VERSION = "version"
    UNAUTHORIZED = "unauthorized"
    NAME_TAKEN = "name_taken"
    HANDSHAKE_TIMEOUT = "handshake_timeout"
    TOO_MANY = "too_many"
    OVERFLOW = "overflow"
    SHUTTING_DOWN = "shutting_down"
    SILENT = "silent"
    KICKED = "kicked"
    # One message was of no effect.
    UNKNOWN_TYPE = "unknown_type"
    INVALID_MESSAGE = "invalid_message"
    UNKNOWN_ROBOT = "unknown_robot"
    UNKNOWN_ASSET = "unknown_asset"
    UNKNOWN_FIELD = "unknown_field"
    UNKNOWN_STOP = "unknown_stop"
    UNKNOWN_SESSION = "unknown_session"
    FORBIDDEN = "forbidden"
    LEASED = "leased"
    NOT_HELD = "not_held"
    STOPPED = "stopped"
    MOVING = "moving"
    NO_LOCKSTEP = "no_lockstep"
    NOT_PARTICIPANT = "not_participant"
    WRONG_STEP = "wrong_step"
    SIGNAL_OWNED = "signal_owned"
    SIGNAL_RATE = "signal_rate"
    TOO_MANY_SIGNALS = "too_many_signals"
    INTERNAL = "internal"


@dataclass(frozen=True, slots=True)
class CodeInfo:
    """One row of the table of codes: does it end the connection, what does it mean, what can be done."""

    fatal: bool
    meaning: str
    advice: str


def _fatal(meaning: str, advice: str) -> CodeInfo:
    return CodeInfo(True, meaning, advice)


def _single(meaning: str, advice: str) -> CodeInfo:
    return CodeInfo(False, meaning, advice)


CODES: dict[ErrorCode, CodeInfo] = {
    ErrorCode.FRAME_TOO_LARGE: _fatal("a frame's length is beyond the limit", "send smaller messages"),
    ErrorCode.EMPTY_FRAME: _fatal("a frame's length is 0", "send a message in every frame"),
    ErrorCode.TRUNCATED: _fatal("the stream ended inside a frame", "connect again"),
    ErrorCode.MALFORMED: _fatal("a payload is not a well-formed map of this protocol", "repair the encoder"),
    ErrorCode.UNEXPECTED: _fatal("this message is not allowed now", "follow the connection's state machine"),
    ErrorCode.VERSION: _fatal("no version in common, or a downgrade", "use a version that both sides list"),
    ErrorCode.UNAUTHORIZED: _fatal("the token does not allow this", "use a valid token for this role"),
    ErrorCode.NAME_TAKEN: _fatal(
        "another session uses this name", "choose another name, or end that session"
    ),
    ErrorCode.HANDSHAKE_TIMEOUT: _fatal("no hello came in time", "say hello at once after connecting"),
    ErrorCode.TOO_MANY: _fatal(
        "the server holds as many connections as it may", "close some, try again later"
    ),
    ErrorCode.OVERFLOW: _fatal("messages that may not be dropped were not read", "read faster"),
    ErrorCode.SHUTTING_DOWN: _fatal("the server is ending", "connect again when it runs"),
    ErrorCode.SILENT: _fatal(
        "a participant gave no sign of life while all waited", "answer every step, or pass"
    ),
    ErrorCode.KICKED: _fatal("an operator ended the session", "ask the operator"),
    ErrorCode.UNKNOWN_TYPE: _single(
        "this version has no message of that type", "see the welcome's capabilities"
    ),
    ErrorCode.INVALID_MESSAGE: _single("a field is missing or has the wrong form", "repair the field named"),
    ErrorCode.UNKNOWN_ROBOT: _single("the cell has no such robot", "use a name from the description"),
    ErrorCode.UNKNOWN_ASSET: _single(
        "no such asset, or an offset beyond its end", "use hash and size as described"
    ),
    ErrorCode.UNKNOWN_FIELD: _single("the state has no such field", "use the fields of a state entry"),
    ErrorCode.UNKNOWN_STOP: _single("no such stop is in force", "use the id of the stopped message"),
    ErrorCode.UNKNOWN_SESSION: _single("there is no such session", "use an id of the session list"),
    ErrorCode.FORBIDDEN: _single("this role may not do that", "connect with a role that may"),
    ErrorCode.LEASED: _single("another session holds the robot", "wait, or take it over as an operator"),
    ErrorCode.NOT_HELD: _single("the session does not hold that lease", "acquire the robot"),
    ErrorCode.STOPPED: _single("the robot is stopped", "have an operator reset the stop, then acquire again"),
    ErrorCode.MOVING: _single("a robot still moves", "reset when it rests"),
    ErrorCode.NO_LOCKSTEP: _single("the server does not run in lock-step", "send no pass"),
    ErrorCode.NOT_PARTICIPANT: _single(
        "this session is no participant of the lock-step", "connect by its name"
    ),
    ErrorCode.WRONG_STEP: _single("a pass for another step than the current", "name the newest state's step"),
    ErrorCode.SIGNAL_OWNED: _single("another session owns the signal", "use another name"),
    ErrorCode.SIGNAL_RATE: _single("signals come too fast; this one was dropped", "send them less often"),
    ErrorCode.TOO_MANY_SIGNALS: _single("the table of signals is full", "share fewer signals"),
    ErrorCode.INTERNAL: _single("the server failed to do it", "read the server's log"),
}


def as_name(value: object) -> str | None:
    """``value`` if it may stand where a message wants a name, else None: a peer's text is not trusted."""
    return value if isinstance(value, str) and _NAME.fullmatch(value) else None


class ProtocolError(Exception):
    """Something is wrong with a message or a frame.

    Attributes:
        code: Which kind, see ``CODES``.
        text: What was wrong, for people; bounded, without secrets.
        fatal: Whether the connection ends; by default as the table says.
        about: The ``type`` of the message meant, where known.
        seq: The command's ``seq``, where it could be read.
        re: The request's ``id``, where it could be read.
    """

    def __init__(
        self,
        code: ErrorCode,
        text: str,
        *,
        fatal: bool | None = None,
        about: str | None = None,
        seq: int | None = None,
        re: int | None = None,
    ) -> None:
        super().__init__(f"{code}: {text}")
        self.code = code
        self.text = text if len(text) <= MAX_TEXT else text[: MAX_TEXT - 1] + "…"
        self.fatal = CODES[code].fatal if fatal is None else fatal
        self.about = as_name(about)
        self.seq = seq
        self.re = re

    def message(self) -> Error:
        """The error message that tells the peer."""
        return Error(
            re=self.re, code=self.code.value, text=self.text, fatal=self.fatal, about=self.about, seq=self.seq
        )


class LocalProtocolError(ProtocolError):
    """My own side's fault; nothing was sent and the connection's state is unchanged."""


class RemoteProtocolError(ProtocolError):
    """The peer's fault."""
