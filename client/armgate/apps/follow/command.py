"""``armgate follow``: takes the robot with the camera and keeps it on another robot's tool."""

from typing import Annotated

import typer

from armgate.apps.connection import Ca, Cert, Key, TokenFile, login
from armgate.cell.text import printable


def follow(
    address: Annotated[str, typer.Argument(metavar="HOST:PORT", help="Where the daemon listens.")],
    *,
    robot: Annotated[str, typer.Option(help="Robot that carries the camera.", show_default=False)],
    leader: Annotated[
        str,
        typer.Option(help="Robot whose tool it looks at, and that it stays clear of.", show_default=False),
    ],
    focus: Annotated[
        tuple[float, float, float] | None,
        typer.Option(metavar="X Y Z", help="A fixed place to look at instead, world, m.", show_default=False),
    ] = None,
    distance: Annotated[
        float,
        typer.Option(
            min=0.05,
            max=100.0,
            help="Wanted view distance, m, until the signal operator.distance says another.",
        ),
    ] = 1.0,
    lag: Annotated[
        float, typer.Option(min=0.0, max=10.0, help="Known lag of the camera's robot behind its setpoint, s.")
    ] = 0.03,
    predict: Annotated[
        bool, typer.Option(help="Look at where the tool will be, or at where it was measured.")
    ] = True,
    duration: Annotated[
        float | None,
        typer.Option(
            min=0.1, metavar="S", help="Follow for S seconds; else until the leader is done, or Ctrl-C."
        ),
    ] = None,
    name: Annotated[str, typer.Option(help="This participant's name.")] = "follower",
    token_file: TokenFile = None,
    ca: Ca = None,
    cert: Cert = None,
    key: Key = None,
) -> None:
    """Keep a robot's camera on another robot's tool."""
    from armgate.apps.follow.loop import FollowLoop, Wish, chase
    from armgate.apps.interrupt import interrupt
    from armgate.apps.sharing import Sharing
    from armgate.client import connect
    from armgate.control.compiled import prepare

    prepare()
    own = login(token_file, ca, cert, key)
    with interrupt() as wish, connect(address, name=name, role="controller", **own) as cell:
        wanted = Wish(distance, lag, focus=focus, predict=predict)
        loop = FollowLoop.build(cell, robot, leader, wanted)
        cell.subscribe(every=1, robots=[robot], fields=["q", "setpoint", "stop_end", "nearest", "holder"])
        with cell.acquire(robot) as arm:
            ended = chase(Sharing(cell, _echo), arm, loop, wish, duration)
    _echo(f"{robot}: {ended}")


def _echo(text: str) -> None:
    typer.echo(printable(text))
