"""``armgate ellipsoid``: draws manipulability ellipses along a motion."""

from pathlib import Path
from typing import Annotated

import typer


def ellipsoid(
    configs: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="CONFIG…",
            help="The cell's configuration, later files overlay earlier ones; "
            "the planar arm if none is named.",
            show_default=False,
        ),
    ] = None,
    *,
    robot: Annotated[
        str | None, typer.Option(help="The robot; the cell's first if none is named.", show_default=False)
    ] = None,
    frame: Annotated[
        str | None, typer.Option(help="The frame; the robot's tool if none is named.", show_default=False)
    ] = None,
    path: Annotated[
        Path | None,
        typer.Option(
            help="Draw along a recorded path, as lead plays and reach writes it.", show_default=False
        ),
    ] = None,
    self_motion: Annotated[
        bool, typer.Option("--self-motion", help="Draw along the self motion through the start position.")
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Draw the force ellipses too.")] = False,
    count: Annotated[int, typer.Option(min=1, max=100, help="How many positions to draw.")] = 8,
    out: Annotated[Path, typer.Option(help="The picture, .png or .svg.")] = Path("ellipsoids.png"),
) -> None:
    """Draw manipulability ellipses along a motion."""
    from armgate.apps.data import default_file
    from armgate.apps.ellipsoid.motion import motion_of
    from armgate.apps.ellipsoid.picture import draw
    from armgate.cell.cell import build_cell
    from armgate.cell.config import load_config

    cell = build_cell(load_config(configs or [default_file("planar.yaml")]))
    motion = motion_of(cell, robot, frame, path, self_motion=self_motion)
    typer.echo(draw(motion, out, count=count, force=force))
