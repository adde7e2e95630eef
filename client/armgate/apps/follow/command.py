"""``armgate follow``: acquire the robot with the camera and keep the camera on another robot's tool."""

from typing import Annotated

import typer

from armgate.apps.connection import Address, Ca, Cert, Key, TokenFile, login
from armgate.cell.terminal_text import printable

Robot = Annotated[str, typer.Option(help="Robot that carries the camera.", show_default=False)]
Leader = Annotated[
    str,
    typer.Option(help="Robot whose tool the camera points at; it is also an obstacle.", show_default=False),
]
Focus = Annotated[
    tuple[float, float, float] | None,
    typer.Option(
        metavar="X Y Z",
        help="Fixed target of the camera instead of the tool, in the world, m.",
        show_default=False,
    ),
]
Distance = Annotated[
    float,
    typer.Option(
        min=0.05, max=100.0, help="Wanted view distance, m; the signal operator.distance overrides it."
    ),
]
Lag = Annotated[
    float, typer.Option(min=0.0, max=10.0, help="Known lag of the camera's robot behind its setpoint, s.")
]
Predict = Annotated[
    bool, typer.Option(help="Aim at the predicted position of the tool, or at the measured one.")
]
Duration = Annotated[
    float | None,
    typer.Option(
        min=0.1, metavar="S", help="Follow for S seconds (default: until the leader has finished, or Ctrl-C)."
    ),
]
Name = Annotated[str, typer.Option(help="Name of this client.")]


def follow(
    address: Address,
    *,
    robot: Robot,
    leader: Leader,
    focus: Focus = None,
    distance: Distance = 1.0,
    lag: Lag = 0.03,
    predict: Predict = True,
    duration: Duration = None,
    name: Name = "follower",
    token_file: TokenFile = None,
    ca: Ca = None,
    cert: Cert = None,
    key: Key = None,
) -> None:
    """Keep a robot's camera on another robot's tool."""
    from armgate.apps.errors import text_of
    from armgate.apps.follow.loop import FollowOptions
    from armgate.apps.follow.program import FollowProgram
    from armgate.apps.interrupt import catch_interrupt
    from armgate.cell.compilation import announced
    from armgate.client import connect
    from armgate.client.program import run
    from armgate.control.compiled import prepare

    with announced():
        prepare()
    own = login(token_file, ca, cert, key)
    options = FollowOptions(distance, lag, focus=focus, predict=predict)
    with catch_interrupt() as interrupt, connect(address, name=name, role="controller", **own) as cell:
        program = FollowProgram.build(cell, robot, leader, options, duration)
        outcome = run(cell, robot, program, interrupt=interrupt, report=_echo)
    _echo(f"{robot}: {text_of(outcome)}")


def _echo(text: str) -> None:
    typer.echo(printable(text))
