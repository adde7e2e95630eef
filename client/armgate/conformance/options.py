"""Options of a run, and the conversion of the command line's texts and files into them."""

import ssl
import stat
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from armgate.conformance.case import Case, select_cases
from armgate.conformance.fault_injection import Faults

_TOKEN_OWNERS = ("operator", "controller", "observer", "elsewhere")


class UsageError(Exception):
    """The kit was called incorrectly."""

    exit_code = 2


@dataclass
class Options:
    """Options of a run; the command's help describes them.

    Attributes:
        wire_logs: Folder for the wire log of each failure; None: no wire logs.
    """

    address: tuple[str, int] | None
    start: str | None
    cases: Sequence[Case]
    strict: bool = False
    robot: str | None = None
    participants: tuple[str, ...] = ()
    tokens: dict[str, str] = field(default_factory=dict)
    tls: ssl.SSLContext | None = None
    faults: Faults = field(default_factory=Faults)
    seed: int = 1
    junit: Path | None = None
    html: Path | None = None
    wire_logs: Path | None = None

    def set_reports(self, junit: Path | None, html: Path | None, out: Path | None) -> None:
        """Set the files of the reports: those given, otherwise those in the folder ``out`` if it is given.

        Raises:
            UsageError: The folder of a file does not exist or cannot be created, or a file is a folder.
        """
        self.junit, self.html = junit, html
        if out is not None:
            self.junit = junit or out / "junit.xml"
            self.html = html or out / "report.html"
            self.wire_logs = _make_folder(out / "wire")
        for file in filter(None, (self.junit, self.html)):
            if not file.resolve().parent.is_dir():
                raise UsageError(f"{file}: there is no folder {file.resolve().parent}")
            if file.is_dir():
                raise UsageError(f"{file}: is a folder; expected the name of a file")


def _make_folder(folder: Path) -> Path:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        text = f"cannot be created ({error.strerror}); choose another folder with --out"
        raise UsageError(f"{folder}: {text}") from error
    return folder


def chosen_cases(only: list[str]) -> Sequence[Case]:
    """Return the cases that the user named, or all.

    Raises:
        UsageError: A name matches no case.
    """
    try:
        return select_cases(only)
    except LookupError as error:
        raise UsageError(str(error.args[0])) from error


def server_address(text: str | None, start: str | None) -> tuple[str, int] | None:
    """Return host and port of ``HOST:PORT``; None if the server is started by a command.

    Raises:
        UsageError: The text is not an address, the command is empty, or not exactly one of them is given.
    """
    if (text is None) == (start is None):
        raise UsageError("give either HOST:PORT or --start COMMAND")
    if start is not None and not start.strip():
        raise UsageError("--start: the command is empty; expected a command that starts a server")
    if text is None:
        return None
    host, _, port = text.rpartition(":")
    if not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise UsageError(f"{text!r} is not an address; write HOST:PORT, such as 127.0.0.1:7411")
    return host.strip("[]"), int(port)


def names(text: str) -> tuple[str, ...]:
    """Return the names of a comma-separated list."""
    return tuple(filter(None, (name.strip() for name in text.split(","))))


def tls_context(authority: Path | None, certificate: Path | None, key: Path | None) -> ssl.SSLContext | None:
    """Return the TLS context for a trusted certificate, and for the kit's own certificate and key.

    Raises:
        UsageError: Only some of the files are given, or one cannot be read.
    """
    if (certificate is None) is not (key is None) or (certificate is not None and authority is None):
        raise UsageError("--tls-cert and --tls-key need each other and --tls-ca")
    if authority is None:
        return None
    given = authority
    try:
        context = ssl.create_default_context(cafile=str(authority))
        if certificate is not None and key is not None:
            given = certificate
            context.load_cert_chain(certificate, key)
    except OSError as error:
        raise UsageError(f"{given}: {error.strerror or error}; expected a file in PEM") from error
    return context


def tokens_of(file: Path | None) -> dict[str, str]:
    """Return the tokens of a file by role; a line with only a token is for the operator.

    Raises:
        UsageError: Other users can read the file, or a line has another form.
    """
    tokens: dict[str, str] = {}
    if file is None:
        return tokens
    try:
        if file.stat().st_mode & (stat.S_IRWXG | stat.S_IRWXO):
            text = "other users of this machine can read these secrets"
            raise UsageError(f"--token-file {file}: {text}; run: chmod 600 {file}")
        lines = file.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"--token-file {file}: {error}; expected lines `ROLE TOKEN`") from error
    for number, text in enumerate(lines, start=1):
        words = text.split()
        if not words or text.startswith("#"):
            continue
        role, token = words if len(words) == 2 else ("operator", words[0])
        if len(words) > 2 or role not in _TOKEN_OWNERS:
            owners = ", ".join(_TOKEN_OWNERS)
            raise UsageError(f"{file}:{number}: expected ROLE TOKEN, with ROLE one of {owners}")
        tokens[role] = token
    return tokens
