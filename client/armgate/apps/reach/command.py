"""``armgate reach``: acquire a robot and move one of its frames to a target."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from armgate.apps.connection import Address, Ca, Cert, Key, TokenFile, login
from armgate.cell.terminal_text import printable


class MethodName(StrEnum):
    """Methods of ``armgate.control.redundancy.reach``, repeated because the help must not import it."""

    PSEUDO = "pseudo"
    DAMPED = "damped"
    VARIABLE = "variable"
    TRANSPOSE = "transpose"


class ObjectiveName(StrEnum):
    """Null-space objectives."""

    SINGULARITIES = "singularities"
    LIMITS = "limits"
    OBSTACLES = "obstacles"


Triple = tuple[float, float, float] | None
Robot = Annotated[str, typer.Option(help="Robot to move.", show_default=False)]
Target = Annotated[
    Triple,
    typer.Option(
        metavar="X Y Z",
        help="Target position of the frame in the world, m (default: keep it).",
        show_default=False,
    ),
]
Rpy = Annotated[
    Triple,
    typer.Option(
        metavar="R P Y",
        help="Target orientation: roll, pitch, yaw in degrees (default: keep it).",
        show_default=False,
    ),
]
Frame = Annotated[
    str | None, typer.Option(help="Frame to move (default: the robot's tool).", show_default=False)
]
Rows = Annotated[str, typer.Option(help="Rows of the task, world axes: some of x,y,z,rx,ry,rz.")]
Method = Annotated[
    MethodName, typer.Option(help="Inverse of the Jacobian, from the error to joint velocities.")
]
Objectives = Annotated[
    list[ObjectiveName] | None,
    typer.Option(
        help="Null-space objective: move away from singularities, limits or obstacles; repeat to combine.",
        show_default=False,
    ),
]
Gain = Annotated[float, typer.Option(min=0.01, max=20.0, help="Task velocity per error, 1/s.")]
Speed = Annotated[float, typer.Option(min=0.001, help="Largest task velocity, m/s and rad/s.")]
Damping = Annotated[
    float, typer.Option(min=1e-6, help="Damping factor (maximum if the method is `variable`).")
]
Clear = Annotated[
    float, typer.Option(min=0.001, help="Distance below which an obstacle repels the robot, m.")
]
Tolerance = Annotated[float, typer.Option(min=1e-6, help="Convergence tolerance, m and rad.")]
Duration = Annotated[float, typer.Option(min=0.1, metavar="S", help="Timeout: abort after S seconds.")]
Out = Annotated[
    Path | None,
    typer.Option(help="Write the motion as a path file, for lead and ellipsoid.", show_default=False),
]
Name = Annotated[str, typer.Option(help="Name of this client.")]


def reach(
    address: Address,
    *,
    robot: Robot,
    target: Target = None,
    rpy: Rpy = None,
    frame: Frame = None,
    rows: Rows = "x,y,z",
    method: Method = MethodName.DAMPED,
    objective: Objectives = None,
    gain: Gain = 2.0,
    speed: Speed = 0.25,
    damping: Damping = 0.05,
    clear: Clear = 0.3,
    tolerance: Tolerance = 1e-3,
    duration: Duration = 60.0,
    out: Out = None,
    name: Name = "reach",
    token_file: TokenFile = None,
    ca: Ca = None,
    cert: Cert = None,
    key: Key = None,
) -> None:
    """Move a frame of a robot to a target."""
    from armgate.apps.interrupt import catch_interrupt
    from armgate.apps.reach.goal import Goal, tuning
    from armgate.apps.reach.program import reach as move
    from armgate.client import connect

    _check_out(out)
    goal = Goal(
        frame=frame,
        rows=tuple(row.strip() for row in rows.split(",")),
        xyz=target,
        rpy_deg=rpy,
        tuning=tuning(method.value, gain, speed, damping),
        objectives=tuple(one.value for one in objective or ()),
        clear=clear,
    )
    own = login(token_file, ca, cert, key)
    with catch_interrupt() as interrupt, connect(address, name=name, role="controller", **own) as cell:
        text = move(cell, robot, goal, interrupt, typer.echo, tolerance=tolerance, duration=duration, out=out)
    typer.echo(printable(f"{robot}: {text}"))


def _check_out(file: Path | None) -> None:
    """Check that a path file can be written to this place, before the robot moves.

    Raises:
        UsageError: Its folder does not exist, or it is a folder itself.
    """
    from armgate.apps.errors import UsageError
    from armgate.recording.files import output_problem

    if file is not None and (problem := output_problem(file)) is not None:
        raise UsageError(f"--out {file}: {problem}")
