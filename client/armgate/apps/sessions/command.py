"""``armgate sessions``: list the sessions of a daemon, or end one."""

from typing import TYPE_CHECKING, Annotated

import typer

from armgate.apps.connection import Address, Ca, Cert, Key, TokenFile, login

if TYPE_CHECKING:
    from armgate.client import SessionInfo


def sessions(
    address: Address,
    *,
    kick: Annotated[
        str | None,
        typer.Option(metavar="SESSION", help="End the session with this id.", show_default=False),
    ] = None,
    reason: Annotated[str, typer.Option(help="With --kick: the reason sent to the client.")] = "",
    name: Annotated[str, typer.Option(help="Name of this client.")] = "sessions",
    token_file: TokenFile = None,
    ca: Ca = None,
    cert: Cert = None,
    key: Key = None,
) -> None:
    """List the sessions of a daemon (id, name, role, token, address, held robots), or end one (operators)."""
    from armgate.cell.terminal_text import printable
    from armgate.client import connect

    own = login(token_file, ca, cert, key)
    with connect(address, name=name, role="operator", **own) as cell:
        if kick is not None:
            cell.kick(kick, reason)
            typer.echo(f"session {printable(kick)} has ended")
            return
        for session in cell.sessions():
            typer.echo(printable(_line(session)))


def _line(session: "SessionInfo") -> str:
    held = ", ".join(session.robots) or "no robot"
    token = "no token" if session.token is None else f"token {session.token}"
    return f"{session.session}  {session.name}  {session.role}  {token}  {session.address}  {held}"
