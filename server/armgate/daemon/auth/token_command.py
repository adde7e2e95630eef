"""``armgate token``: create a token for one client, or rotate its secret."""

import getpass
import hashlib
import os
import ssl
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

if TYPE_CHECKING:
    from armgate.daemon.auth.tokens import Made, Token

ALL = "all"

_LONGEST_CERTIFICATE = 1 << 16
"""Largest number of characters that are read from a certificate file; a device file has no end."""

_File = Annotated[Path, typer.Option(help="Token file of the daemon (server.tokens); created if missing.")]
_Role = Annotated[
    Literal["observer", "controller", "operator"] | None,
    typer.Option(
        help="Highest role that the token allows; required unless --rotate is given.", show_default=False
    ),
]
_Robots = Annotated[
    str, typer.Option(metavar="NAMES", help="Robots that its owner may command: A,B,… or all.")
]
_Name = Annotated[
    str | None, typer.Option(help="Name of its owner in the log; default: this user's name and the role.")
]
_Out = Annotated[
    Path | None,
    typer.Option(help="New file for the secret, readable by this user only; default: print the secret."),
]
_Days = Annotated[
    float | None, typer.Option(min=0.0, help="Days until the token expires.", show_default="never")
]
_Certificate = Annotated[
    Path | None,
    typer.Option(help="Bind the role to this client certificate (PEM) instead of creating a secret."),
]
_Rotate = Annotated[str | None, typer.Option(metavar="NAME", help="Give this token a new secret.")]
_Overlap = Annotated[
    float, typer.Option(min=0.0, help="With --rotate: hours for which the old secret stays valid.")
]


class CalledWronglyError(Exception):
    """Wrong call of the command; nothing was created."""

    exit_code = 2


def token(
    file: _File,
    *,
    role: _Role = None,
    robots: _Robots = ALL,
    name: _Name = None,
    out: _Out = None,
    days: _Days = None,
    certificate: _Certificate = None,
    rotate: _Rotate = None,
    overlap: _Overlap = 0.0,
) -> None:
    """Create a token; prints the secret once, or writes it to a file, and stores only its hash."""
    _check_out(out)
    if rotate is not None:
        if role or name or certificate or days is not None or robots != ALL:
            raise CalledWronglyError("--rotate: expected no other options than --file, --overlap and --out")
        _rotate(file, rotate, overlap, out)
        return
    if role is None:
        raise CalledWronglyError("--role: expected observer, controller or operator")
    made = _make(role, robots, name, days)
    may = "observe and stop" if role == "observer" else f"command {'all robots' if robots == ALL else robots}"
    what = f"may connect as {role} and {may}"
    if certificate is None:
        _append(file, made.token)
        _report(made.token, what, made.secret, out)
    else:
        bound = {"sha256": None, "certificate": _digest(certificate)}
        _append(file, made.token.model_copy(update=bound))
        typer.echo(f"armgate: {made.token.name} {what}, with the certificate {certificate}", err=True)


def _make(
    role: Literal["observer", "controller", "operator"], robots: str, name: str | None, days: float | None
) -> "Made":
    from armgate.daemon.auth.tokens import make

    named = None if robots == ALL else tuple(robot.strip() for robot in robots.split(","))
    expires = None if days is None else _after(days=days)
    try:
        return make(name or f"{getpass.getuser()}-{role}", role, named, expires)
    except ValueError as error:
        text = f"--name {name!r}, --robots {robots!r}: expected names of 1 to 64 of A-Z a-z 0-9 _ . : / -"
        raise CalledWronglyError(text) from error


def _append(file: Path, made: "Token") -> None:
    from armgate.daemon.auth.tokens import append

    append(file, made)


def _rotate(file: Path, name: str, overlap: float, out: Path | None) -> None:
    from armgate.daemon.auth.tokens import rotate

    made = rotate(file, name, _after(hours=overlap) if overlap else None)
    valid = f"the old secret stays valid for {overlap:g} h at most"
    _report(made.token, f"has a new secret, {valid}", made.secret, out)


def _after(**duration: float) -> datetime:
    return (datetime.now(UTC) + timedelta(**duration)).replace(microsecond=0)


def _digest(certificate: Path) -> str:
    try:
        with certificate.open(encoding="ascii") as file:
            text = file.read(_LONGEST_CERTIFICATE)
        return hashlib.sha256(ssl.PEM_cert_to_DER_cert(text)).hexdigest()
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or "not a certificate"
        raise CalledWronglyError(f"--certificate {certificate}: {reason}; expected a PEM file") from error


def _report(made: "Token", what: str, secret: str, out: Path | None) -> None:
    where = "printed this once:" if out is None else f"in {out}, for this user only"
    if out is not None:
        _write(out, secret)
    typer.echo(f"armgate: {made.name} {what}; its secret is {where}", err=True)
    if out is None:
        typer.echo(secret)


def _check_out(out: Path | None) -> None:
    """Check the place for the secret before its hash is stored: a secret that cannot be written is lost."""
    if out is None:
        return
    if os.path.lexists(out):
        raise CalledWronglyError(f"--out {out}: the file exists; remove it, or name another file")
    if not out.parent.is_dir():
        raise CalledWronglyError(
            f"--out {out}: there is no folder {out.parent}; create it, or name another file"
        )
    if not os.access(out.parent, os.W_OK | os.X_OK):
        raise CalledWronglyError(f"--out {out}: {out.parent} is not writable; name another file")


def _write(out: Path, secret: str) -> None:
    with os.fdopen(os.open(out, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
        file.write(secret + "\n")
