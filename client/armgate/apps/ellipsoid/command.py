"""``armgate ellipsoid``: draw manipulability ellipses along a motion."""

from pathlib import Path
from typing import Annotated

import typer


def ellipsoid(
    configs: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="CONFIG",
            help="Configuration of the cell; later files overlay earlier ones (default: the planar arm).",
            show_default=False,
        ),
    ] = None,
    *,
    robot: Annotated[
        str | None, typer.Option(help="Robot (default: the first one of the cell).", show_default=False)
    ] = None,
    frame: Annotated[
        str | None, typer.Option(help="Frame (default: the robot's tool).", show_default=False)
    ] = None,
    path: Annotated[
        Path | None,
        typer.Option(
            help="Draw along a path file, in the format that lead plays and reach writes.", show_default=False
        ),
    ] = None,
    self_motion: Annotated[
        bool, typer.Option("--self-motion", help="Draw along the self-motion through the start position.")
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Also draw the force ellipses.")] = False,
    count: Annotated[int, typer.Option(min=1, max=100, help="Number of positions to draw.")] = 8,
    out: Annotated[Path, typer.Option(help="Picture to write, .png or .svg.")] = Path("ellipsoids.png"),
) -> None:
    """Draw manipulability ellipses along a motion."""
    from armgate.apps.default_files import default_file
    from armgate.apps.ellipsoid.motion import motion_of
    from armgate.apps.ellipsoid.picture import draw
    from armgate.cell.cell import build_cell
    from armgate.cell.config import load_config

    cell = build_cell(load_config(configs or [default_file("planar.yaml")]))
    motion = motion_of(cell, robot, frame, path, self_motion=self_motion)
    typer.echo(draw(motion, out, count=count, force=force))
