"""``armgate view``: show a cell on a web page, with STOP, reset, zoom and manual driving."""

import re
from pathlib import Path
from typing import Annotated, Literal

import typer

from armgate.apps.connection import Ca, Cert, Key, TokenFile, login

Source = Annotated[
    str,
    typer.Argument(
        metavar="HOST:PORT|unix:PATH|RUN",
        help="Address or Unix socket of the daemon; or a recording: a run's folder or one of its files.",
    ),
]
Role = Annotated[
    Literal["observer", "controller", "operator"],
    typer.Option(
        help="Role of the page: observers press STOP; controllers also drive; operators also reset and zoom."
    ),
]
Host = Annotated[str, typer.Option(help="Address on which the page is served.")]
Port = Annotated[int, typer.Option(min=0, max=65535, help="Port of the page; 0 selects a free port.")]
HostName = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME[:PORT]",
        help="Additional host name of the page, such as that of a reverse proxy; repeatable.",
    ),
]
Speed = Annotated[
    float, typer.Option(min=0.01, max=1.0, help="Driving: largest share of the robots' speeds.")
]
Meshes = Annotated[
    bool, typer.Option(help="Draw known arms with their real meshes, if the extra `meshes` is installed.")
]
Open = Annotated[bool, typer.Option("--open/--no-open", help="Open a browser.")]
Name = Annotated[str, typer.Option(help="Name of this client.")]


def view(
    source: Source = "127.0.0.1:7411",
    *,
    role: Role = "observer",
    host: Host = "127.0.0.1",
    port: Port = 7480,
    host_name: HostName = None,
    speed: Speed = 0.25,
    meshes: Meshes = True,
    open_: Open = False,
    name: Name = "view",
    token_file: TokenFile = None,
    ca: Ca = None,
    cert: Cert = None,
    key: Key = None,
) -> None:
    """Show a cell, or a recording of one, on a web page."""
    from armgate.apps.errors import UsageError
    from armgate.apps.view.access import Access, parse_names
    from armgate.apps.view.serving import Place, play, serve
    from armgate.apps.view.viewer import Style

    try:
        at = Place(host, port, Access(host, parse_names(host_name or [])))
    except ValueError as error:
        raise UsageError(f"--host-name {error}: expected NAME or NAME:PORT") from error
    if recorded(source):
        if role != "observer":
            raise UsageError(
                f"{source} is a recording: the page can only observe it; leave out --role {role}"
            )
        play(Path(source), style=Style(meshes=meshes), at=at, open_browser=open_, report=typer.echo)
        return
    own = login(token_file, ca, cert, key)
    serve(
        source,
        name,
        role,
        own,
        style=Style(speed, meshes),
        at=at,
        open_browser=open_,
        report=typer.echo,
    )


def recorded(source: str) -> bool:
    """Return True if the source is the path of a recording, not an address."""
    if source.startswith("unix:"):
        return False
    return Path(source).exists() or re.search(r":\d+$", source) is None
