"""``armgate view``: shows a cell on a web page, and lets its user stop, reset, zoom and drive."""

from typing import Annotated, Literal

import typer

from armgate.apps.login import Ca, Cert, Key, TokenFile, login


def view(
    address: Annotated[
        str, typer.Argument(metavar="HOST:PORT", help="Where the daemon listens.")
    ] = "127.0.0.1:7411",
    *,
    role: Annotated[
        Literal["observer", "controller", "operator"],
        typer.Option(help="What the page may do: look on and STOP; drive robots, too; reset and zoom, too."),
    ] = "observer",
    host: Annotated[str, typer.Option(help="Address on which the page is served.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="Its port; 0 for any that is free.")] = 7480,
    speed: Annotated[
        float, typer.Option(min=0.01, max=1.0, help="Driving: the largest share of the robots' speeds.")
    ] = 0.25,
    open_: Annotated[bool, typer.Option("--open/--no-open", help="Open a browser.")] = False,
    name: Annotated[str, typer.Option(help="This client's name.")] = "view",
    token_file: TokenFile = None,
    ca: Ca = None,
    cert: Cert = None,
    key: Key = None,
) -> None:
    """Show a cell on a web page."""
    from armgate.apps.view.serving import serve  # noqa: PLC0415

    own = login(token_file, ca, cert, key)
    serve(address, name, role, own, speed=speed, at=(host, port), open_browser=open_, tell=typer.echo)
