"""``armgate lead``: takes a robot and drives it along a recorded path, by hand, or after another robot."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from armgate.apps.connection import Ca, Cert, Key, TokenFile, login
from armgate.cell.text import printable

if TYPE_CHECKING:
    from armgate.apps.interrupt import Interrupt
    from armgate.client import Cell


def lead(
    address: Annotated[str, typer.Argument(metavar="HOST:PORT", help="Where the daemon listens.")],
    *,
    path: Annotated[Path | None, typer.Option(help="File of a recorded path.", show_default=False)] = None,
    by: Annotated[
        str | None,
        typer.Option("--input", metavar="NAME", help="Drive by hand: gamepad, keyboard.", show_default=False),
    ] = None,
    pursue: Annotated[
        str | None,
        typer.Option(
            metavar="ROBOT/BODY", help="Go for a body of another robot, until Ctrl-C.", show_default=False
        ),
    ] = None,
    robot: Annotated[
        str | None,
        typer.Option(help="Robot to drive; the one that the path was recorded with if none is named."),
    ] = None,
    duration: Annotated[
        float | None,
        typer.Option(min=0.1, metavar="S", help="Play only the first S seconds and come to rest."),
    ] = None,
    mode: Annotated[
        Literal["joint", "tool"], typer.Option(help="By hand: move joints or the tool first.")
    ] = "joint",
    speed: Annotated[
        float, typer.Option(min=0.01, max=1.0, help="By hand: the largest share of the robot's speeds.")
    ] = 0.25,
    tool_speed: Annotated[
        float, typer.Option(min=0.001, metavar="M/S", help="In a pursuit: the tool's speed.")
    ] = 0.25,
    name: Annotated[str, typer.Option(help="This participant's name.")] = "leader",
    token_file: TokenFile = None,
    ca: Ca = None,
    cert: Cert = None,
    key: Key = None,
) -> None:
    """Drive a robot along a recorded path (--path), by hand (--input), or after another one (--pursue)."""
    from armgate.apps.errors import UsageError
    from armgate.apps.interrupt import interrupt
    from armgate.client import connect

    if sum(way is not None for way in (path, by, pursue)) != 1:
        raise UsageError("give one of --path FILE, --input NAME and --pursue ROBOT/BODY")
    if path is not None:
        run = _along(path, robot, duration)
    elif by is not None:
        run = _by_hand(by, robot, mode, speed)
    else:
        run = _after(str(pursue), robot, tool_speed)
    own = login(token_file, ca, cert, key)
    with interrupt() as wish, connect(address, name=name, role="controller", **own) as cell:
        typer.echo(printable(run(cell, wish)))


Run = Callable[["Cell", "Interrupt"], str]


def _along(path: Path, robot: str | None, duration: float | None) -> Run:
    from armgate.apps.lead.drive import bounds_of, check_path, drive
    from armgate.apps.lead.path import read_path
    from armgate.apps.lead.playback import Playback

    recorded = read_path(path)

    def run(cell: "Cell", wish: "Interrupt") -> str:
        described = check_path(recorded, cell.description, robot or recorded.robot)
        cell.subscribe(every=1, robots=[described.name], fields=["q", "setpoint"])
        playback = Playback(recorded, bounds_of(described), duration)
        with cell.acquire(described.name) as arm:
            return f"{described.name}: {drive(cell, arm, playback, wish, _echo)}"

    return run


def _by_hand(by: str, robot: str | None, mode: Literal["joint", "tool"], speed: float) -> Run:
    from armgate.apps.lead.hand import Hand, drive_by_hand
    from armgate.apps.lead.inputs import find

    hand = Hand(find(by), robot, mode, speed)
    return lambda cell, wish: drive_by_hand(cell, hand, wish, _echo)


def _after(target: str, robot: str | None, speed: float) -> Run:
    from armgate.apps.lead.pursuit import pursue

    return lambda cell, wish: pursue(cell, robot, target, speed, wish, _echo)


def _echo(text: str) -> None:
    typer.echo(printable(text))
