"""The server's side of TLS, from the configuration."""

import ssl
import stat
from pathlib import Path


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
    if key.stat().st_mode & stat.S_IROTH:
        raise TlsError(f"{key}: everybody on this machine may read the private key; run: chmod 600 {key}")
    try:
        context.load_cert_chain(certificate, key, password=_no_password)
    except (ssl.SSLError, ValueError) as error:
        text = f"{certificate} and {key}: {_told(error)}"
        raise TlsError(f"{text}; expected a certificate and its unencrypted key, both in PEM") from error
    if client_ca is not None:
        try:
            context.load_verify_locations(client_ca)
        except ssl.SSLError as error:
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
    return getattr(error, "reason", None) or str(error)
