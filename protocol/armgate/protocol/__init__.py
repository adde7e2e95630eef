"""The wire: what controllers, observers and the daemon say to each other over TCP, without I/O.

``messages`` (the models), ``framing`` (cuts the stream), ``codec`` (bytes to messages and back),
``connection`` (who may say what when), ``versions`` (which version, and what is said in it), ``lease`` (who
may command a robot), ``errors`` (exceptions and the table of codes). SPEC.md beside this file is the same in
words, ``statements`` reads it.

The messages themselves are used as ``messages.State`` etc.: their short names (``Stop``, ``Error``) say
little alone.
"""

from armgate.protocol import messages
from armgate.protocol.codec import answering, decode, encode
from armgate.protocol.connection import Connection, ConnectionState, Refusal, Side
from armgate.protocol.errors import CODES, ErrorCode, LocalProtocolError, ProtocolError, RemoteProtocolError
from armgate.protocol.framing import (
    HANDSHAKE_LIMIT,
    INBOUND_LIMIT,
    OUTBOUND_LIMIT,
    FrameDecoder,
)
from armgate.protocol.lease import Denial, Grant, Leases, LeaseState, Loss
from armgate.protocol.versions import DIALECTS, VERSIONS, Dialect

__all__ = [
    "CODES",
    "DIALECTS",
    "HANDSHAKE_LIMIT",
    "INBOUND_LIMIT",
    "OUTBOUND_LIMIT",
    "VERSIONS",
    "Connection",
    "ConnectionState",
    "Denial",
    "Dialect",
    "ErrorCode",
    "FrameDecoder",
    "Grant",
    "LeaseState",
    "Leases",
    "LocalProtocolError",
    "Loss",
    "ProtocolError",
    "Refusal",
    "RemoteProtocolError",
    "Side",
    "answering",
    "decode",
    "encode",
    "messages",
]
