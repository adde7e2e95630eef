"""``armgate zoom``: simulate an operator who changes the wanted view distance."""

from typing import Annotated

import typer

from armgate.apps.connection import Address, Ca, Cert, Key, TokenFile, login
from armgate.cell.terminal_text import printable


def zoom(
    address: Address,
    *,
    low: Annotated[float, typer.Option(min=0.05, help="Smallest wanted distance, m.")] = 0.5,
    high: Annotated[float, typer.Option(min=0.05, help="Largest wanted distance, m.")] = 1.3,
    start: Annotated[float, typer.Option(min=0.05, help="Initial wanted distance, m.")] = 1.0,
    rate: Annotated[float, typer.Option(min=0.001, help="Rate of change, m/s.")] = 0.1,
    seed: Annotated[int, typer.Option(help="Seed of the random distances.")] = 0,
    duration: Annotated[
        float | None,
        typer.Option(
            min=0.1, metavar="S", help="End after S seconds (default: at Ctrl-C).", show_default=False
        ),
    ] = None,
    name: Annotated[str, typer.Option(help="Name of this client.")] = "operator",
    token_file: TokenFile = None,
    ca: Ca = None,
    cert: Cert = None,
    key: Key = None,
) -> None:
    """Change the wanted view distance as an operator would."""
    from armgate.apps.interrupt import catch_interrupt
    from armgate.apps.zoom.schedule import DistanceSchedule, ZoomProgram
    from armgate.client import connect
    from armgate.client.program import run

    program = ZoomProgram(DistanceSchedule(low, high, start, rate, seed), duration)
    own = login(token_file, ca, cert, key)
    with catch_interrupt() as interrupt, connect(address, name=name, role="operator", **own) as cell:
        run(cell, None, program, interrupt=interrupt, report=_echo)


def _echo(text: str) -> None:
    typer.echo(printable(text))
