"""Signatures of recordings: Ed25519, with the package cryptography (extra ``sign``)."""

from pathlib import Path

from armgate.audit.errors import AuditError, UseError
from armgate.recording.chain import Seal

_LONGEST_KEY = 1 << 16
"""Number of bytes of a key file that are read."""


def public_key(file: Path) -> bytes:
    """Return the 32 bytes of an Ed25519 public key in PEM.

    Raises:
        UseError: The file cannot be read, or does not hold such a key.
    """
    from cryptography.exceptions import UnsupportedAlgorithm
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey
    from cryptography.hazmat.primitives.serialization import load_pem_public_key

    try:
        with file.open("rb") as stream:
            key = load_pem_public_key(stream.read(_LONGEST_KEY))
    except OSError as error:
        raise UseError(f"{file}: {error.strerror}; expected an Ed25519 public key in PEM") from error
    except (ValueError, UnsupportedAlgorithm) as error:
        raise UseError(f"{file}: expected an Ed25519 public key in PEM") from error
    if not isinstance(key, Ed25519PublicKey):
        raise UseError(f"{file}: expected an Ed25519 public key in PEM")
    return key.public_bytes_raw()


def check_signature(seal: Seal, public: bytes | None) -> str:
    """Check the signature of a seal.

    Args:
        seal: The seal.
        public: The key with which it must be signed; None: the key that the seal names.

    Returns:
        Fingerprint of the key.

    Raises:
        AuditError: The seal is not signed, or not with this key.
    """
    from cryptography.exceptions import InvalidSignature
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey

    if not seal.signature:
        raise AuditError("the recording is not signed")
    if public is not None and public != seal.public:
        raise AuditError("the recording is signed with another key")
    try:
        Ed25519PublicKey.from_public_bytes(seal.public).verify(seal.signature, seal.digest)
    except (InvalidSignature, ValueError) as error:
        raise AuditError("the signature of the recording is wrong") from error
    return fingerprint(seal.public)


def fingerprint(public: bytes) -> str:
    """Return the beginning of the SHA-256 of a public key."""
    from hashlib import sha256  # noqa: PLC0415

    return sha256(public).hexdigest()[:16]
