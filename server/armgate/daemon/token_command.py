"""``armgate token``: makes a token for one client."""

import getpass
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
) -> None:
    """Make a token: its secret is printed once, only its hash is kept."""
    from armgate.daemon.tokens import append, make  # noqa: PLC0415

    named = None if robots == ALL else [robot.strip() for robot in robots.split(",")]
    try:
        made = make(name or f"{getpass.getuser()}-{role}", role, named)
    except ValueError as error:
        text = f"--name {name!r}, --robots {robots!r}: expected names of 1 to 64 of A-Z a-z 0-9 _ . : / -"
        raise CalledWronglyError(text) from error
    append(file, made.token)
    may = "watch and stop" if role == "observer" else f"command {'all robots' if named is None else robots}"
    typer.echo(
        f"armgate: {made.token.name} may come in as {role} and {may}; its secret is shown this once:",
        err=True,
    )
    typer.echo(made.secret)
