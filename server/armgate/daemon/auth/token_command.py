"""``armgate token``: makes a token for one client."""

import getpass
import hashlib
import os
import ssl
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

if TYPE_CHECKING:
    from armgate.daemon.auth.tokens import Token

ALL = "all"

_LONGEST_CERTIFICATE = 1 << 16
"""Most characters of a certificate's file that are read; a device has no end."""


class CalledWronglyError(Exception):
    """The command was called wrongly; nothing was made."""

    exit_code = 2


def token(
    file: Annotated[Path, typer.Option(help="File of the daemon's tokens (server.tokens); made if missing.")],
    *,
    role: Annotated[
        Literal["observer", "controller", "operator"] | None,
        typer.Option(help="The most that it allows; required unless --rotate is given.", show_default=False),
    ] = None,
    robots: Annotated[
        str, typer.Option(metavar="NAMES", help="Robots that it lets command: A,B,… or all.")
    ] = ALL,
    name: Annotated[
        str | None,
        typer.Option(help="Whose it is, as the log will say; by default who calls this and the role."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="New file for the secret, readable by this user alone; else it is printed."),
    ] = None,
    days: Annotated[
        float | None, typer.Option(min=0.0, help="Days until it expires.", show_default="never")
    ] = None,
    certificate: Annotated[
        Path | None,
        typer.Option(help="Bind the role to this client certificate (PEM) instead of making a secret."),
    ] = None,
    rotate: Annotated[
        str | None, typer.Option(metavar="NAME", help="Give the token of this name a new secret.")
    ] = None,
    overlap: Annotated[
        float, typer.Option(min=0.0, help="With --rotate: hours that the old secret stays valid.")
    ] = 0.0,
) -> None:
    """Create a token; prints the secret once, or writes it to a file, and stores only its hash."""
    from armgate.daemon.auth import tokens

    _check_free(out)
    if rotate is not None:
        if role or name or certificate or days is not None or robots != ALL:
            raise CalledWronglyError("--rotate: expected only --file, --overlap and --out beside it")
        made = tokens.rotate(file, rotate, _after(hours=overlap) if overlap else None)
        valid = f"the old one is valid for {overlap:g} h more at most"
        _tell(made.token, f"has a new secret, {valid}", made.secret, out)
        return
    if role is None:
        raise CalledWronglyError("--role: expected observer, controller or operator")
    named = None if robots == ALL else tuple(robot.strip() for robot in robots.split(","))
    expires = None if days is None else _after(days=days)
    try:
        made = tokens.make(name or f"{getpass.getuser()}-{role}", role, named, expires)
    except ValueError as error:
        text = f"--name {name!r}, --robots {robots!r}: expected names of 1 to 64 of A-Z a-z 0-9 _ . : / -"
        raise CalledWronglyError(text) from error
    may = "watch and stop" if role == "observer" else f"command {'all robots' if named is None else robots}"
    what = f"may come in as {role} and {may}"
    if certificate is None:
        tokens.append(file, made.token)
        _tell(made.token, what, made.secret, out)
    else:
        bound = {"sha256": None, "certificate": _digest(certificate)}
        tokens.append(file, made.token.model_copy(update=bound))
        typer.echo(f"armgate: {made.token.name} {what}, with the certificate {certificate}", err=True)


def _after(**duration: float) -> datetime:
    return (datetime.now(UTC) + timedelta(**duration)).replace(microsecond=0)


def _digest(certificate: Path) -> str:
    try:
        with certificate.open(encoding="ascii") as file:
            text = file.read(_LONGEST_CERTIFICATE)
        return hashlib.sha256(ssl.PEM_cert_to_DER_cert(text)).hexdigest()
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or "no certificate"
        raise CalledWronglyError(f"--certificate {certificate}: {reason}; expected one in PEM") from error


def _tell(token: "Token", what: str, secret: str, out: Path | None) -> None:
    where = "shown this once:" if out is None else f"in {out}, for this user alone"
    typer.echo(f"armgate: {token.name} {what}; its secret is {where}", err=True)
    if out is None:
        typer.echo(secret)
    else:
        _write(out, secret)


def _check_free(out: Path | None) -> None:
    if out is not None and os.path.lexists(out):
        raise CalledWronglyError(f"--out {out}: it is there already; remove it, or name another file")


def _write(out: Path, secret: str) -> None:
    with os.fdopen(os.open(out, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
        file.write(secret + "\n")
