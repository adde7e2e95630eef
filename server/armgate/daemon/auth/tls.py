"""The server's side of TLS, from the configuration."""

import asyncio
import ssl
from collections.abc import Iterator
from pathlib import Path

from armgate.protocol.secret_file import SecretFileError, check_secret_file

_EXTENSIONS = 0xA3
_OCTETS, _OID = 0x04, 0x06
_KEY_USAGE = bytes.fromhex("551d25")
"""2.5.29.37, extended key usage."""
_CLIENT = bytes.fromhex("2b06010505070302")
"""1.3.6.1.5.5.7.3.2, client authentication."""


class TlsError(Exception):
    """A certificate or a key cannot be used; the text names the file and says why."""

    exit_code = 2


def server_context(certificate: Path, key: Path, client_ca: Path | None) -> ssl.SSLContext:
    """What connections are encrypted with.

    Args:
        certificate: The server's certificate, then those between it and its CA.
        key: Its private key.
        client_ca: Where given, clients must show a certificate that one of these CAs has signed.

    Raises:
        TlsError: A file cannot be read or does not fit.
    """
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    for file in (certificate, key, client_ca):
        if file is not None:
            _check(file)
    try:
        check_secret_file(key)
    except (SecretFileError, OSError) as error:
        raise TlsError(str(error)) from error
    try:
        context.load_cert_chain(certificate, key, password=_no_password)
    except (OSError, ValueError) as error:
        text = f"{certificate} and {key}: {_told(error)}"
        raise TlsError(f"{text}; expected a certificate and its unencrypted key, both in PEM") from error
    if client_ca is not None:
        try:
            context.load_verify_locations(client_ca)
        except OSError as error:
            raise TlsError(f"{client_ca}: {_told(error)}; expected certificates of CAs in PEM") from error
        context.verify_mode = ssl.CERT_REQUIRED
    return context


def _check(file: Path) -> None:
    try:
        with file.open("rb"):
            pass
    except OSError as error:
        raise TlsError(f"{file}: {error.strerror}; expected a file in PEM, see server.tls") from error


def _no_password() -> str:
    raise ValueError("the key is encrypted")


def _told(error: Exception) -> str:
    return getattr(error, "reason", None) or getattr(error, "strerror", None) or str(error)


def peer_certificate(transport: asyncio.BaseTransport) -> bytes | None:
    """Return the certificate that a client has shown over TLS, in DER; None without one."""
    tls = transport.get_extra_info("ssl_object")
    certificate: bytes | None = None if tls is None else tls.getpeercert(binary_form=True)
    return certificate


# --- the purpose of a certificate -------------------------------------------------------------------------


def is_for_clients(certificate: bytes) -> bool:
    """Return True if a certificate names clients in its extended key usage.

    The TLS library accepts a certificate that names no purpose for every purpose, so that the daemon's own
    certificate would make a client of whoever can read its key.

    Args:
        certificate: In DER, verified by the TLS library.
    """
    try:
        return any(oid == _CLIENT for oid in _purposes(certificate))
    except Exception:  # a client made these bytes: whatever cannot be read names no purpose
        return False


def _purposes(certificate: bytes) -> Iterator[bytes]:
    """Yield the purposes in the extended key usage (RFC 5280, 4.2.1.12)."""
    ((_, whole),) = _items(certificate)
    _, signed = next(_items(whole))
    for tag, wrapped in _items(signed):
        if tag == _EXTENSIONS:
            ((_, extensions),) = _items(wrapped)
            for _, extension in _items(extensions):
                parts = dict(_items(extension))
                if parts[_OID] == _KEY_USAGE:
                    ((_, purposes),) = _items(parts[_OCTETS])
                    yield from (oid for _, oid in _items(purposes))


def _items(der: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield tag and content of the values that stand one after the other (X.690, 8.1)."""
    at = 0
    while at < len(der):
        tag, length, at = der[at], der[at + 1], at + 2
        if length & 0x80:
            count = length & 0x7F
            length, at = int.from_bytes(der[at : at + count], "big"), at + count
        if at + length > len(der):
            raise ValueError("a value ends beyond its container")
        yield tag, der[at : at + length]
        at += length
