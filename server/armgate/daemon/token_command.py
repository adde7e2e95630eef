"""``armgate token``: makes a token for one client."""

import getpass
import os
from pathlib import Path
from typing import Annotated, Literal

import typer

ALL = "all"


class CalledWronglyError(Exception):
    """The command was called wrongly; nothing was made."""

    exit_code = 2


def token(
    role: Annotated[
        Literal["observer", "controller", "operator"], typer.Option(help="The most that it allows.")
    ],
    file: Annotated[Path, typer.Option(help="File of the daemon's tokens (server.tokens); made if missing.")],
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
) -> None:
    """Create a token; prints the secret once, or writes it to a file, and stores only its hash."""
    from armgate.daemon.tokens import append, make  # noqa: PLC0415

    named = None if robots == ALL else [robot.strip() for robot in robots.split(",")]
    try:
        made = make(name or f"{getpass.getuser()}-{role}", role, named)
    except ValueError as error:
        text = f"--name {name!r}, --robots {robots!r}: expected names of 1 to 64 of A-Z a-z 0-9 _ . : / -"
        raise CalledWronglyError(text) from error
    _check_free(out)
    append(file, made.token)
    may = "watch and stop" if role == "observer" else f"command {'all robots' if named is None else robots}"
    where = "shown this once:" if out is None else f"in {out}, for this user alone"
    typer.echo(f"armgate: {made.token.name} may come in as {role} and {may}; its secret is {where}", err=True)
    if out is None:
        typer.echo(made.secret)
    else:
        _write(out, made.secret)


def _check_free(out: Path | None) -> None:
    if out is not None and os.path.lexists(out):
        raise CalledWronglyError(f"--out {out}: it is there already; remove it, or name another file")


def _write(out: Path, secret: str) -> None:
    with os.fdopen(os.open(out, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
        file.write(secret + "\n")
