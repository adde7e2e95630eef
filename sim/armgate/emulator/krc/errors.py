"""Errors of a virtual KRC.

KrcError       the KRC's file, its context or its robot cannot be used; nothing was sent
XmlError       a text is not XML that a KRC accepts
ReplyError     a datagram is not the reply of a cycle; the KRC logs it and does not use it
ConsoleError   a command on stdin has no effect
"""

from enum import StrEnum


class KrcError(Exception):
    """Unusable options of a virtual KRC; the text gives the place, the reason and the expectation."""

    exit_code = 2


class XmlError(Exception):
    """Text that a KRC does not accept as XML; the error's text gives the reason."""


class Fault(StrEnum):
    """Reason for which a datagram was not accepted as the reply of a cycle."""

    STRANGER = "stranger"
    XML = "xml"
    ROOT = "root"
    SENTYPE = "sentype"
    VALUE = "value"
    NO_IPOC = "no_ipoc"
    WRONG_IPOC = "wrong_ipoc"
    LATE = "late"
    DOUBLE = "double"


class ReplyError(Exception):
    """Datagram that is not a valid reply.

    Attributes:
        fault: Reason.
    """

    def __init__(self, fault: Fault, text: str) -> None:
        super().__init__(text)
        self.fault = fault


class ConsoleError(Exception):
    """Console command without effect; the text gives the reason."""
