"""TLS of the daemon: its certificate, and the certificates of clients."""

import asyncio
import ssl
from collections.abc import Iterator
from pathlib import Path

from armgate.protocol.secret_file import SecretFileError, check_secret_file

_EXTENSIONS, _OCTETS, _OID = 0xA3, 0x04, 0x06
"""Tags of DER (X.690): extensions of a certificate, octet string, object identifier."""
_KEY_USAGE = bytes.fromhex("551d25")
"""2.5.29.37, extended key usage."""
_CLIENT = bytes.fromhex("2b06010505070302")
"""1.3.6.1.5.5.7.3.2, client authentication."""


class TlsError(Exception):
    """Unusable certificate or key; the text names the file and the reason."""

    exit_code = 2


def server_context(certificate: Path, key: Path, client_ca: Path | None) -> ssl.SSLContext:
    """Return the TLS settings of the daemon's connections.

    Args:
        certificate: File of the server's certificate, followed by the intermediate certificates.
        key: File of its private key.
        client_ca: File of CAs; if given, clients must show a certificate that one of them has signed.

    Raises:
        TlsError: A file cannot be read, or certificate and key do not belong together.
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
        text = f"{certificate} and {key}: {_reason(error)}"
        raise TlsError(f"{text}; expected a certificate and its unencrypted key, both in PEM") from error
    if client_ca is not None:
        try:
            context.load_verify_locations(client_ca)
        except OSError as error:
            raise TlsError(f"{client_ca}: {_reason(error)}; expected certificates of CAs in PEM") from error
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


def _reason(error: Exception) -> str:
    return getattr(error, "reason", None) or getattr(error, "strerror", None) or str(error)


def peer_certificate(transport: asyncio.BaseTransport) -> bytes | None:
    """Return the certificate that a client has shown over TLS, in DER; None without one."""
    tls = transport.get_extra_info("ssl_object")
    certificate: bytes | None = None if tls is None else tls.getpeercert(binary_form=True)
    return certificate


# --- purpose of a certificate -----------------------------------------------------------------------------


def is_for_clients(certificate: bytes) -> bool:
    """Return True if a certificate names clients in its extended key usage.

    The TLS library accepts a certificate without this extension for every purpose. If the daemon did so too,
    a user who can read the key of the daemon's own certificate could connect with it as a client.

    Args:
        certificate: A certificate in DER that the TLS library has verified.
    """
    try:
        return any(oid == _CLIENT for oid in _purposes(certificate))
    except Exception:  # sent by a client: a certificate that cannot be parsed names no purpose
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
    """Yield tag and content of consecutive values (X.690, 8.1)."""
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
