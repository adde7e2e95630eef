"""Ed25519 key that signs recordings, from the package cryptography (extra ``sign``)."""

import os
import stat
from collections.abc import Callable
from pathlib import Path

from armgate.cell.errors import install_hint
from armgate.recording.chain import Signer

_LONGEST = 1 << 16
"""Largest number of bytes that are read from a key file; a device file has no end."""


class SignerError(Exception):
    """Unusable key; the text gives the reason and the remedy."""

    exit_code = 2


def load_signer(file: Path) -> Signer:
    """Load a private key from a PEM file without a password.

    Raises:
        SignerError: It cannot be used.
    """
    try:
        from cryptography.exceptions import UnsupportedAlgorithm
        from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
        from cryptography.hazmat.primitives.serialization import load_pem_private_key
    except ModuleNotFoundError as error:
        raise SignerError(f"cryptography is not installed; run {install_hint('sign')}") from error
    try:
        key = load_pem_private_key(_private(file), password=None)
    except (ValueError, TypeError, UnsupportedAlgorithm) as error:
        raise SignerError(f"{file}: expected an Ed25519 private key in PEM, without a password") from error
    if not isinstance(key, Ed25519PrivateKey):
        raise SignerError(f"{file}: expected an Ed25519 key; create one: openssl genpkey -algorithm ed25519")
    return _Key(key.public_key().public_bytes_raw(), key.sign)


def _private(file: Path) -> bytes:
    """Return the content of a file, which only its owner may read."""
    try:
        with file.open("rb") as opened:
            mode, data = os.fstat(opened.fileno()).st_mode, opened.read(_LONGEST)
    except OSError as error:
        raise SignerError(f"{file}: {error.strerror or error}") from error
    if mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise SignerError(f"{file}: other users may use this key; run: chmod 600 {file}")
    return data


class _Key:
    def __init__(self, public: bytes, sign: Callable[[bytes], bytes]) -> None:
        self.public = public
        self._sign = sign

    def sign(self, data: bytes, /) -> bytes:
        return self._sign(data)
