"""Tokens and TLS of a connection, for both shells."""

import ipaddress
import os
import socket
import ssl
from pathlib import Path
from typing import Any

from armgate.client.errors import BadArgument, ConnectionLost
from armgate.protocol.secret_file import SecretFileError, check_secret_file, read_secret_file

_LONGEST_TOKEN = 256

Tls = bool | str | os.PathLike[str] | ssl.SSLContext | None
"""None or False: no TLS; True: TLS with the system's CAs; otherwise the file of a CA, or a context."""


def read_token(file: str | os.PathLike[str]) -> str:
    """Return the token in a file, as ``armgate token --out`` writes it.

    Raises:
        BadArgument: The file cannot be read, holds no token, belongs to another user, or other users can read
            it.
    """
    path = Path(file)
    try:
        token = read_secret_file(path).strip()
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "not a text"
        raise BadArgument(f"{path}: {reason}; expected a token") from error
    except SecretFileError as error:
        raise BadArgument(str(error)) from error
    if not 0 < len(token) <= _LONGEST_TOKEN or len(token.split()) != 1:
        raise BadArgument(f"{path}: expected one token and nothing else, as `armgate token` prints it")
    return token


def tls_context(
    ca: str | os.PathLike[str] | None = None,
    certificate: str | os.PathLike[str] | None = None,
    key: str | os.PathLike[str] | None = None,
) -> ssl.SSLContext:
    """Return a context that verifies the server's certificate and host name; files are in PEM.

    Args:
        ca: Certificates of the trusted CAs; None: the system's CAs.
        certificate: Certificate of this client, if the daemon requires one.
        key: Private key of the certificate; None: ``certificate`` also holds the key.

    Raises:
        BadArgument: A file cannot be read or used.
    """
    if key is not None and certificate is None:
        raise BadArgument(f"key {os.fspath(key)}: needs a certificate; give both")
    try:
        context = ssl.create_default_context(cafile=ca)
        if certificate is not None:
            _check_key(certificate if key is None else key)
            context.load_cert_chain(certificate, key, password=_no_password)
    except BadArgument:
        raise
    except (OSError, ValueError) as error:
        files = ", ".join(os.fspath(file) for file in (ca, certificate, key) if file is not None)
        raise BadArgument(
            f"{files}: {_reason(error)}; expected certificates and an unencrypted key in PEM"
        ) from error
    return context


def context_of(tls: Tls) -> ssl.SSLContext | None:
    """Return the context for the ``tls`` argument of ``connect``.

    Raises:
        BadArgument: The file cannot be read or used.
    """
    if tls is None or tls is False:
        return None
    if isinstance(tls, ssl.SSLContext):
        return tls
    return tls_context(None if tls is True else tls)


def no_connection(address: str, error: OSError) -> ConnectionLost:
    """Return the exception for a failed connection, with its cause and a remedy."""
    if isinstance(error, ssl.SSLCertVerificationError):
        text = f"{error.verify_message}; give the CA of the server's certificate (tls=…, --ca FILE)"
    elif isinstance(error, ssl.SSLError):
        text = f"{_reason(error)}; does the daemon use TLS?"
    elif isinstance(error, socket.gaierror):
        text = f"{error.strerror}; check the host"
    else:
        text = f"{error.strerror or error}; is `armgate serve` running there?"
    return ConnectionLost(f"no connection to {address}: {text}")


def check_token(token: str | None, tls: ssl.SSLContext | None, peer: Any) -> None:
    """Check that a token is sent over a network only with encryption.

    Args:
        token: Token to send.
        tls: Context of the connection; None: no encryption.
        peer: Address of the connected socket's peer.

    Raises:
        BadArgument: The token would be sent unencrypted over a network; nothing was sent.
    """
    if token is None or tls is not None or _is_local(peer):
        return
    raise BadArgument(
        f"token: would cross the network to {peer[0]} unencrypted; connect with tls=… (--ca FILE)"
    )


def _is_local(peer: Any) -> bool:
    """Return True if the peer is on this machine; the address of a Unix socket is a path."""
    return isinstance(peer, str | bytes) or ipaddress.ip_address(peer[0].partition("%")[0]).is_loopback


def check_no_tls(address: str, tls: ssl.SSLContext | None) -> None:
    """Check that TLS is not requested on a Unix socket.

    Raises:
        BadArgument: TLS is requested.
    """
    if tls is not None:
        raise BadArgument(f"tls: {address} is a Unix socket, which does not use TLS; omit tls")


def _check_key(file: str | os.PathLike[str]) -> None:
    """Check that a private key belongs to this user, and that other users cannot read it.

    Raises:
        OSError: The file cannot be read.
        BadArgument: The file belongs to another user, or other users can read it.
    """
    try:
        check_secret_file(Path(file))
    except SecretFileError as error:
        raise BadArgument(str(error)) from error


def _reason(error: Exception) -> str:
    return getattr(error, "reason", None) or getattr(error, "strerror", None) or str(error)


def _no_password() -> str:
    raise ValueError("the key is encrypted")
