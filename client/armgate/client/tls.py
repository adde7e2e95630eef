"""TLS for both shells: what is trusted, and what to say where it fails."""

import ipaddress
import os
import ssl
from typing import Any

from armgate.client.errors import BadArgument, ConnectionLost
from armgate.client.secret import check_key

Tls = bool | str | os.PathLike[str] | ssl.SSLContext | None
"""None or False: without TLS; True: trusting the system's CAs; else the file with the CA, or a context."""


def tls_context(
    ca: str | os.PathLike[str] | None = None,
    certificate: str | os.PathLike[str] | None = None,
    key: str | os.PathLike[str] | None = None,
) -> ssl.SSLContext:
    """A context that checks the server's certificate and its name; files are in PEM.

    Args:
        ca: Certificates of the CAs that are trusted; None: the system's.
        certificate: This client's own certificate, where the daemon asks for one.
        key: Its private key; None: it stands in ``certificate`` too.

    Raises:
        BadArgument: A file cannot be read or used.
    """
    if key is not None and certificate is None:
        raise BadArgument(f"key {os.fspath(key)}: there is no certificate that it belongs to; give both")
    try:
        context = ssl.create_default_context(cafile=ca)
        if certificate is not None:
            check_key(certificate if key is None else key)
            context.load_cert_chain(certificate, key, password=_no_password)
    except BadArgument:
        raise
    except (OSError, ValueError) as error:
        files = ", ".join(os.fspath(file) for file in (ca, certificate, key) if file is not None)
        raise BadArgument(f"{files}: {_told(error)}; expected certificates and an open key in PEM") from error
    return context


def context_of(tls: Tls) -> ssl.SSLContext | None:
    """The context that ``connect`` was asked for.

    Raises:
        BadArgument: The file cannot be read or used.
    """
    if tls is None or tls is False:
        return None
    if isinstance(tls, ssl.SSLContext):
        return tls
    return tls_context(None if tls is True else tls)


def no_connection(address: str, error: OSError) -> ConnectionLost:
    """Why there is none, and what to do."""
    if isinstance(error, ssl.SSLCertVerificationError):
        text = f"{error.verify_message}; give the CA that signed its certificate (tls=…, --ca FILE)"
    elif isinstance(error, ssl.SSLError):
        text = f"{_told(error)}; does the daemon there speak TLS?"
    else:
        text = f"{error.strerror or error}; does `armgate serve` run there?"
    return ConnectionLost(f"no connection to {address}: {text}")


def check_token(token: str | None, tls: ssl.SSLContext | None, peer: Any) -> None:
    """A token crosses a network only encrypted.

    Args:
        token: What would be sent.
        tls: What encrypts it.
        peer: The address that the socket is connected to.

    Raises:
        BadArgument: It would be readable on the way; nothing was sent.
    """
    if token is None or tls is not None or _is_local(peer):
        return
    raise BadArgument(
        f"token: everybody on the way to {peer[0]} could read it; connect with tls=… (--ca FILE)"
    )


def _is_local(peer: Any) -> bool:
    """Return True if the other end is on this machine; the address of a Unix socket is a path."""
    return isinstance(peer, str | bytes) or ipaddress.ip_address(peer[0].partition("%")[0]).is_loopback


def no_tls_on(address: str, tls: ssl.SSLContext | None) -> None:
    """Check that no TLS is asked for on a Unix socket.

    Raises:
        BadArgument: It is.
    """
    if tls is not None:
        raise BadArgument(f"tls: {address} is a socket of this machine, which speaks no TLS; leave tls out")


def _told(error: Exception) -> str:
    return getattr(error, "reason", None) or getattr(error, "strerror", None) or str(error)


def _no_password() -> str:
    raise ValueError("the key is encrypted")
