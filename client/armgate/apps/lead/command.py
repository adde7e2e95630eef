"""``armgate lead``: takes a robot and drives it along a recorded path."""

from pathlib import Path
from typing import Annotated

import typer

from armgate.apps.login import Ca, Cert, Key, TokenFile, login


def lead(
    address: Annotated[str, typer.Argument(metavar="HOST:PORT", help="Where the daemon listens.")],
    *,
    path: Annotated[Path, typer.Option(help="File of the recorded path.", show_default=False)],
    robot: Annotated[
        str | None,
        typer.Option(help="Robot to drive; the one that the path was recorded with if none is named."),
    ] = None,
    duration: Annotated[
        float | None,
        typer.Option(min=0.1, metavar="S", help="Play only the first S seconds and come to rest."),
    ] = None,
    name: Annotated[str, typer.Option(help="This participant's name.")] = "leader",
    token_file: TokenFile = None,
    ca: Ca = None,
    cert: Cert = None,
    key: Key = None,
) -> None:
    """Drive a robot along a recorded path."""
    from armgate.apps.interrupt import interrupt  # noqa: PLC0415
    from armgate.apps.lead.drive import bounds_of, check_path, drive  # noqa: PLC0415
    from armgate.apps.lead.path import read_path  # noqa: PLC0415
    from armgate.apps.lead.playback import Playback  # noqa: PLC0415
    from armgate.client import connect  # noqa: PLC0415

    recorded = read_path(path)
    own = login(token_file, ca, cert, key)
    with interrupt() as wish, connect(address, name=name, role="controller", **own) as cell:
        described = check_path(recorded, cell.description, robot or recorded.robot)
        cell.subscribe(every=1, robots=[described.name], fields=["q", "setpoint"])
        playback = Playback(recorded, bounds_of(described), duration)
        with cell.acquire(described.name) as arm:
            ended = drive(cell, arm, playback, wish, typer.echo)
    typer.echo(f"{described.name}: {ended}")
