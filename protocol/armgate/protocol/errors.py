"""Exceptions of the protocol, and the table of error codes.

Exceptions::

    ProtocolError                 invalid message or frame; holds the content of an Error message
    ├── LocalProtocolError        fault of this side: not allowed now, or cannot be encoded
    └── RemoteProtocolError       fault of the peer

``ErrorCode`` lists every code of an :class:`~armgate.protocol.messages.Error`. ``CODES`` states for each code
whether it ends the connection, what it means, and how the peer can react.
"""

import re as regex
from dataclasses import dataclass
from enum import StrEnum

from armgate.protocol.messages import MAX_TEXT, Error

_NAME = regex.compile(r"[A-Za-z0-9_.:/-]{1,64}")


class ErrorCode(StrEnum):
    """Codes of error messages; ``CODES`` explains them."""

    # Fatal: the connection ends.
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
    # One message had no effect.
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
    """Row of the table of error codes.

    Attributes:
        fatal: True if the error ends the connection.
        meaning: Meaning of the code.
        advice: Advice to the peer.
    """

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
    ErrorCode.MALFORMED: _fatal("a payload is not a well-formed map of this protocol", "fix the encoder"),
    ErrorCode.UNEXPECTED: _fatal("this message is not allowed now", "follow the connection's state machine"),
    ErrorCode.VERSION: _fatal(
        "no version in common, or a downgrade", "use a version that both sides support"
    ),
    ErrorCode.UNAUTHORIZED: _fatal("the token does not allow this", "use a valid token for this role"),
    ErrorCode.NAME_TAKEN: _fatal(
        "another session uses this name", "choose another name, or end that session"
    ),
    ErrorCode.HANDSHAKE_TIMEOUT: _fatal("no hello arrived in time", "send hello right after connecting"),
    ErrorCode.TOO_MANY: _fatal(
        "the server has reached its limit of connections", "close some, or try again later"
    ),
    ErrorCode.OVERFLOW: _fatal("the client left answers or verdicts unread", "read faster"),
    ErrorCode.SHUTTING_DOWN: _fatal("the server is shutting down", "connect again when it runs"),
    ErrorCode.SILENT: _fatal(
        "a participant sent nothing while the step waited for it", "send commands or pass in every step"
    ),
    ErrorCode.KICKED: _fatal("an operator ended the session", "ask the operator"),
    ErrorCode.UNKNOWN_TYPE: _single(
        "this version has no message of that type", "see the welcome's capabilities"
    ),
    ErrorCode.INVALID_MESSAGE: _single("a field is missing or has the wrong form", "fix the named field"),
    ErrorCode.UNKNOWN_ROBOT: _single("the cell has no such robot", "use a name from the description"),
    ErrorCode.UNKNOWN_ASSET: _single(
        "no such asset, or an offset beyond its end", "use hash and size of the description"
    ),
    ErrorCode.UNKNOWN_FIELD: _single("the state has no such field", "use the fields of a state entry"),
    ErrorCode.UNKNOWN_STOP: _single("no such stop is in force", "use the id of the stopped message"),
    ErrorCode.UNKNOWN_SESSION: _single("there is no such session", "use an id from the session list"),
    ErrorCode.FORBIDDEN: _single("the role does not allow this", "connect with a role that does"),
    ErrorCode.LEASED: _single(
        "another session holds the robot", "wait, or take the robot over as an operator"
    ),
    ErrorCode.NOT_HELD: _single("the session does not hold that lease", "acquire the robot"),
    ErrorCode.STOPPED: _single("the robot is stopped", "have an operator reset the stop, then acquire again"),
    ErrorCode.MOVING: _single("a robot still moves", "reset when it is at rest"),
    ErrorCode.NO_LOCKSTEP: _single("the server does not run in lock-step", "send no pass"),
    ErrorCode.NOT_PARTICIPANT: _single(
        "this session is not a participant of the lock-step", "connect with a participant's name"
    ),
    ErrorCode.WRONG_STEP: _single(
        "a pass for a step other than the current one", "use the step of the newest state"
    ),
    ErrorCode.SIGNAL_OWNED: _single("another session owns the signal", "use another name"),
    ErrorCode.SIGNAL_RATE: _single(
        "signals arrive too fast; this one was dropped", "send signals less often"
    ),
    ErrorCode.TOO_MANY_SIGNALS: _single("the table of signals is full", "share fewer signals"),
    ErrorCode.INTERNAL: _single("the server failed to handle the message", "read the server's log"),
}


def as_name(value: object) -> str | None:
    """Return ``value`` if it is a valid name, else None: a text of the peer is not trusted."""
    return value if isinstance(value, str) and _NAME.fullmatch(value) else None


class ProtocolError(Exception):
    """Invalid message or frame.

    Attributes:
        code: Error code, see ``CODES``.
        text: Explanation for people; bounded, without secrets.
        fatal: True if the connection ends; by default as in ``CODES``.
        about: ``type`` of the message concerned, if known.
        seq: ``seq`` of the command, if it could be read.
        re: ``id`` of the request, if it could be read.
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
        """Return the error message for the peer."""
        return Error(
            re=self.re, code=self.code.value, text=self.text, fatal=self.fatal, about=self.about, seq=self.seq
        )


class LocalProtocolError(ProtocolError):
    """Fault of this side; nothing was sent and the state of the connection is unchanged."""


class RemoteProtocolError(ProtocolError):
    """Fault of the peer."""
