"""A throwaway CA for tests, made anew in each run."""

import datetime as dt
import ipaddress
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

LIFE = dt.timedelta(days=1)


class Authority:
    """Certificate authority that writes certificates and keys into a folder."""

    def __init__(self, folder: Path, name: str = "ca") -> None:
        self.folder = folder
        self._key = ec.generate_private_key(ec.SECP256R1())
        self._name = _named(name)
        builder = _builder(self._name, self._name, self._key.public_key())
        builder = builder.add_extension(x509.BasicConstraints(ca=True, path_length=None), critical=True)
        use = x509.KeyUsage(
            digital_signature=True, key_cert_sign=True, crl_sign=True, content_commitment=False,
            key_encipherment=False, data_encipherment=False, key_agreement=False, encipher_only=False,
            decipher_only=False,
        )  # fmt: skip
        builder = builder.add_extension(use, critical=True)
        identifier = x509.SubjectKeyIdentifier.from_public_key(self._key.public_key())
        builder = builder.add_extension(identifier, critical=False)
        self.file = self._write(f"{name}.pem", builder.sign(self._key, hashes.SHA256()))

    def issue(
        self, name: str, host: str | None = None, purposes: tuple[str, ...] | None = None
    ) -> tuple[Path, Path]:
        """Issue a certificate and write it and its key to files; return both paths.

        It is for a server with the address ``host``, or for a client if that is None. ``purposes`` are names
        in ``ExtendedKeyUsageOID``; by default CLIENT_AUTH for clients, none for servers.
        """
        key = ec.generate_private_key(ec.SECP256R1())
        builder = _builder(_named(name), self._name, key.public_key())
        issuer = x509.AuthorityKeyIdentifier.from_issuer_public_key(self._key.public_key())
        builder = builder.add_extension(issuer, critical=False)
        if host is not None:
            own = x509.IPAddress(ipaddress.ip_address(host))
            builder = builder.add_extension(x509.SubjectAlternativeName([own]), critical=False)
        if purposes is None:
            purposes = ("CLIENT_AUTH",) if host is None else ()
        if purposes:
            named_ = x509.ExtendedKeyUsage([getattr(ExtendedKeyUsageOID, purpose) for purpose in purposes])
            builder = builder.add_extension(named_, critical=False)
        certificate = self._write(f"{name}.pem", builder.sign(self._key, hashes.SHA256()))
        return certificate, _write_key(self.folder / f"{name}.key", key)

    def _write(self, name: str, certificate: x509.Certificate) -> Path:
        file = self.folder / name
        file.write_bytes(certificate.public_bytes(serialization.Encoding.PEM))
        return file


def encrypted(key: Path) -> Path:
    """Write the key encrypted with a password; return the path."""
    loaded = serialization.load_pem_private_key(key.read_bytes(), None)
    file = key.with_suffix(".locked")
    return _write_key(file, loaded, serialization.BestAvailableEncryption(b"secret"))


def _write_key(file: Path, key, how=None) -> Path:
    form = serialization.PrivateFormat.PKCS8
    how = how or serialization.NoEncryption()
    file.write_bytes(key.private_bytes(serialization.Encoding.PEM, form, how))
    file.chmod(0o600)
    return file


def _named(name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])


def _builder(subject: x509.Name, issuer: x509.Name, key) -> x509.CertificateBuilder:
    now = dt.datetime.now(dt.UTC)
    return x509.CertificateBuilder(
        issuer, subject, key, x509.random_serial_number(), now - LIFE, now + LIFE
    )  # fmt: skip
