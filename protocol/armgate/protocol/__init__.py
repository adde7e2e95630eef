"""The wire protocol between clients and the daemon, without I/O.

Modules: ``messages`` (models), ``framing`` (frames), ``codec`` (bytes to messages and back), ``connection``
(state machine of a connection), ``versions`` (versions and their dialects), ``lease`` (state machine of the
leases), ``errors`` (exceptions and error codes), ``fault_location`` (place of a fault in a payload),
``secret_file`` (files with secrets). SPEC.md in this folder is the specification; ``spec_statements``
parses it.

Use messages as ``messages.State`` etc.: their short names (``Stop``, ``Error``) are unclear alone.
"""

from armgate.protocol import messages
from armgate.protocol.codec import decode, encode, with_re
from armgate.protocol.connection import Connection, ConnectionState, Refusal, Side
from armgate.protocol.errors import CODES, ErrorCode, LocalProtocolError, ProtocolError, RemoteProtocolError
from armgate.protocol.framing import (
    HANDSHAKE_LIMIT,
    INBOUND_LIMIT,
    OUTBOUND_LIMIT,
    FrameDecoder,
    FrameError,
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
    "FrameError",
    "Grant",
    "LeaseState",
    "Leases",
    "LocalProtocolError",
    "Loss",
    "ProtocolError",
    "Refusal",
    "RemoteProtocolError",
    "Side",
    "decode",
    "encode",
    "messages",
    "with_re",
]
