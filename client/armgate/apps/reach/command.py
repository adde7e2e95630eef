"""``armgate reach``: takes a robot and brings one of its frames to a target."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from armgate.apps.connection import Ca, Cert, Key, TokenFile, login
from armgate.cell.text import printable


class MethodName(StrEnum):
    """The controllers of ``armgate.control.redundancy.reach``, which is imported late."""

    PSEUDO = "pseudo"
    DAMPED = "damped"
    VARIABLE = "variable"
    TRANSPOSE = "transpose"


class ObjectiveName(StrEnum):
    """What may be pursued in the null space."""

    SINGULARITIES = "singularities"
    LIMITS = "limits"
    OBSTACLES = "obstacles"


def reach(
    address: Annotated[str, typer.Argument(metavar="HOST:PORT", help="Where the daemon listens.")],
    *,
    robot: Annotated[str, typer.Option(help="Robot to drive.", show_default=False)],
    target: Annotated[
        tuple[float, float, float] | None,
        typer.Option(
            metavar="X Y Z", help="Where to bring the frame, world, m; else it stays.", show_default=False
        ),
    ] = None,
    rpy: Annotated[
        tuple[float, float, float] | None,
        typer.Option(
            metavar="R P Y",
            help="How to turn it: roll, pitch, yaw in degrees; else it stays.",
            show_default=False,
        ),
    ] = None,
    frame: Annotated[
        str | None, typer.Option(help="The frame; the robot's tool if none is named.", show_default=False)
    ] = None,
    rows: Annotated[
        str, typer.Option(help="What the task is: some of x,y,z,rx,ry,rz, world axes.")
    ] = "x,y,z",
    method: Annotated[
        MethodName, typer.Option(help="How joint velocities follow from the error.")
    ] = MethodName.DAMPED,
    objective: Annotated[
        list[ObjectiveName] | None,
        typer.Option(
            help="What to do with the joints that are over: keep away from these. May be given again.",
            show_default=False,
        ),
    ] = None,
    gain: Annotated[float, typer.Option(min=0.01, max=20.0, help="Task velocity per error, 1/s.")] = 2.0,
    speed: Annotated[
        float, typer.Option(min=0.001, help="The task is no faster than this, m/s and rad/s.")
    ] = 0.25,
    damping: Annotated[
        float, typer.Option(min=1e-6, help="k of damped, the largest one of variable.")
    ] = 0.05,
    clear: Annotated[
        float, typer.Option(min=0.001, help="Obstacles nearer than this are kept away from, m.")
    ] = 0.3,
    tolerance: Annotated[float, typer.Option(min=1e-6, help="An error that is none, m and rad.")] = 1e-3,
    duration: Annotated[float, typer.Option(min=0.1, metavar="S", help="Give up after S seconds.")] = 60.0,
    out: Annotated[
        Path | None,
        typer.Option(help="Write the motion as a path file, for lead and ellipsoid.", show_default=False),
    ] = None,
    name: Annotated[str, typer.Option(help="This participant's name.")] = "reach",
    token_file: TokenFile = None,
    ca: Ca = None,
    cert: Cert = None,
    key: Key = None,
) -> None:
    """Bring a frame of a robot to a target."""
    from armgate.apps.interrupt import interrupt
    from armgate.apps.reach.goal import Goal, build
    from armgate.apps.reach.loop import drive, write_motion
    from armgate.apps.sharing import Sharing
    from armgate.client import connect
    from armgate.control.redundancy.reach import Method, Tuning

    goal = Goal(
        frame=frame,
        rows=tuple(row.strip() for row in rows.split(",")),
        xyz=target,
        rpy_deg=rpy,
        tuning=Tuning(Method(method.value), gain=gain, speed=speed, damping=damping),
        objectives=tuple(one.value for one in objective or ()),
        clear=clear,
    )
    own = login(token_file, ca, cert, key)
    with interrupt() as wish, connect(address, name=name, role="controller", **own) as cell:
        arm = build(cell, robot, goal)
        cell.subscribe(every=1, robots=[robot], fields=["q", "setpoint"])
        with cell.acquire(robot) as held:
            done = drive(Sharing(cell, typer.echo), held, arm, wish, tolerance=tolerance, duration=duration)
    if out is not None:
        write_motion(out, arm.robot, done.setpoints)
    done.check(robot)
    typer.echo(printable(f"{robot}: {done.text}"))
