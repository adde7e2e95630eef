"""``armgate lead``: acquire a robot and drive it along a recorded path, by hand, or towards another robot."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from armgate.apps.connection import Address, Ca, Cert, Key, TokenFile, login
from armgate.cell.terminal_text import printable

if TYPE_CHECKING:
    from armgate.apps.interrupt import Interrupt
    from armgate.client import Cell


PathFile = Annotated[
    Path | None,
    typer.Option("--path", help="Drive along the recorded path in this file.", show_default=False),
]
InputName = Annotated[
    str | None,
    typer.Option("--input", metavar="NAME", help="Drive by hand: gamepad or keyboard.", show_default=False),
]
Pursue = Annotated[
    str | None,
    typer.Option(
        metavar="ROBOT/BODY",
        help="Pursue a body of another robot with the tool, until Ctrl-C.",
        show_default=False,
    ),
]
Robot = Annotated[
    str | None,
    typer.Option(help="Robot to drive (default: the robot that the path was recorded with)."),
]
Duration = Annotated[
    float | None,
    typer.Option(min=0.1, metavar="S", help="With --path: play only the first S seconds, then come to rest."),
]
Mode = Annotated[
    Literal["joint", "tool"], typer.Option(help="With --input: start by moving joints, or the tool.")
]
Speed = Annotated[
    float, typer.Option(min=0.01, max=1.0, help="With --input: largest share of the robot's speeds.")
]
ToolSpeed = Annotated[float, typer.Option(min=0.001, metavar="M/S", help="With --pursue: speed of the tool.")]
Name = Annotated[str, typer.Option(help="Name of this client.")]


def lead(
    address: Address,
    *,
    path: PathFile = None,
    by: InputName = None,
    pursue: Pursue = None,
    robot: Robot = None,
    duration: Duration = None,
    mode: Mode = "joint",
    speed: Speed = 0.25,
    tool_speed: ToolSpeed = 0.25,
    name: Name = "leader",
    token_file: TokenFile = None,
    ca: Ca = None,
    cert: Cert = None,
    key: Key = None,
) -> None:
    """Drive a robot along a path (--path), by hand (--input), or towards another robot (--pursue)."""
    from armgate.apps.errors import UsageError
    from armgate.apps.interrupt import catch_interrupt
    from armgate.client import connect

    if sum(way is not None for way in (path, by, pursue)) != 1:
        raise UsageError("expected exactly one of --path FILE, --input NAME and --pursue ROBOT/BODY")
    if path is not None:
        run = _along(path, robot, duration)
    elif by is not None:
        run = _by_hand(by, robot, mode, speed)
    else:
        run = _after(str(pursue), robot, tool_speed)
    own = login(token_file, ca, cert, key)
    with catch_interrupt() as interrupt, connect(address, name=name, role="controller", **own) as cell:
        typer.echo(printable(run(cell, interrupt)))


Run = Callable[["Cell", "Interrupt"], str]


def _along(path: Path, robot: str | None, duration: float | None) -> Run:
    from armgate.apps.errors import text_of
    from armgate.apps.lead.drive import PathProgram, bounds_of, check_path
    from armgate.apps.lead.path import read_path
    from armgate.apps.lead.playback import Playback
    from armgate.client.program import run

    recorded = read_path(path)

    def along(cell: "Cell", interrupt: "Interrupt") -> str:
        described = check_path(recorded, cell.description, robot or recorded.robot)
        program = PathProgram(Playback(recorded, bounds_of(described), duration), _echo)
        outcome = run(cell, described.name, program, interrupt=interrupt, report=_echo)
        return f"{described.name}: {text_of(outcome)}"

    return along


def _by_hand(by: str, robot: str | None, mode: Literal["joint", "tool"], speed: float) -> Run:
    from armgate.apps.lead.inputs import find
    from armgate.apps.lead.manual import ManualDrive, drive_by_hand

    hand = ManualDrive(find(by), robot, mode, speed)
    return lambda cell, interrupt: drive_by_hand(cell, hand, interrupt, _echo)


def _after(target: str, robot: str | None, speed: float) -> Run:
    from armgate.apps.errors import text_of
    from armgate.apps.lead.manual import described_in
    from armgate.apps.lead.pursuit import pursuit_program
    from armgate.client.program import run

    def after(cell: "Cell", interrupt: "Interrupt") -> str:
        name = described_in(cell.description, robot).name
        program = pursuit_program(cell, name, target, speed, _echo)
        return f"{name}: {text_of(run(cell, name, program, interrupt=interrupt, report=_echo))}"

    return after


def _echo(text: str) -> None:
    typer.echo(printable(text))
