"""``armgate rsi``: write the files that a KRC needs, and check a KRC without answering it."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from armgate.cell.terminal_text import printable

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from armgate.cell.cell import Cell, Robot
    from armgate.cell.placement import Placement
    from armgate.links.rsi.commissioning.axis_directions import FlangeInFoot
    from armgate.links.rsi.commissioning.survey import Survey
    from armgate.links.rsi.config import RsiLinkConfig
    from armgate.links.rsi.setup import Setup

rsi = typer.Typer(
    no_args_is_help=True, add_completion=False, help="Configure and check a KUKA RSI connection."
)

Configs = Annotated[
    list[Path],
    typer.Argument(metavar="CONFIG", help="Configuration files; later ones overlay earlier ones."),
]
RobotName = Annotated[str, typer.Option(metavar="NAME", help="Robot of the cell, with a link of kind rsi.")]
Generation = Literal["rsi2", "rsi3"]


class RsiUsageError(Exception):
    """Wrong call of the command; nothing was written."""

    exit_code = 2


class CheckFailedError(Exception):
    """Failed check: KRC and cell do not fit each other."""


@rsi.command()
def config(
    configs: Configs,
    *,
    robot: RobotName,
    pc: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS:PORT", help="Address of this PC on the KRC's network; default: link.listen."
        ),
    ] = None,
    generation: Annotated[
        Generation, typer.Option(help="Generation of RSI; rsi2: KRC2, rsi3: KRC4 and KRC5.")
    ] = "rsi3",
    sentype: Annotated[str, typer.Option(help="Type attribute of replies (SENTYPE).")] = "armgate",
    out: Annotated[Path, typer.Option(help="Folder for the files.")] = Path(),
    force: Annotated[bool, typer.Option("--force", help="Overwrite existing files.")] = False,
) -> None:
    """Write the RSI Ethernet file and a KRL program that match a robot of a cell."""
    from armgate.links.rsi.commissioning import krl
    from armgate.links.rsi.setup import joint_axes

    _, found = _robot(configs, robot)
    link = _rsi_link(found)
    host, port = _address(pc or link.listen or "")
    axes = joint_axes(found, link)
    text = krl.ethernet_xml(axes, host, port, sentype, link.mode == "relative", generation)
    _check_file(text)
    files = {
        out / Path(link.ethernet).name: text,
        out / "armgate_rsi.src": krl.program(axes, link, found.period, generation),
    }
    for path in files:
        if path.exists() and not force:
            raise RsiUsageError(f"{path} exists already; expected --force, or another --out")
    for path, content in files.items():
        path.write_text(content, encoding="utf-8")
        typer.echo(f"written: {path}")


@rsi.command()
def check(
    configs: Configs,
    robot: RobotName,
    seconds: Annotated[float, typer.Option(min=0.1, help="Time to listen [s].")] = 5.0,
    wait: Annotated[
        float, typer.Option(min=0.1, help="Longest time to wait for the first telegram [s].")
    ] = 60.0,
) -> None:
    """Listen to a KRC without answering, and compare its telegrams with the cell.

    The KRC's program ends after Timeout cycles without a reply, unless its file has ONLYSEND TRUE.
    """
    import asyncio

    from armgate.links.rsi.commissioning.survey import Survey
    from armgate.links.rsi.setup import setup_of
    from armgate.links.rsi.udp import listen

    cell, found = _robot(configs, robot)
    setup = setup_of(cell, found)
    survey = Survey(setup, _flange_in_foot(found))
    listening = f"armgate: listening on {setup.listen[0]}:{setup.listen[1]}; never answers"
    asyncio.run(listen(setup.listen, survey.take, seconds, wait, lambda: typer.echo(listening, err=True)))
    _report(setup, survey)


def _rsi_link(robot: "Robot") -> "RsiLinkConfig":
    from armgate.links.rsi.config import RsiLinkConfig

    link = robot.config.link
    if not isinstance(link, RsiLinkConfig):
        raise RsiUsageError(f"{robot.name} has a link of kind {link.kind}; expected rsi")
    return link


def _address(text: str) -> tuple[str, int]:
    host, _, port = text.rpartition(":")
    if not (host and port.isascii() and port.isdigit()):
        raise RsiUsageError("the PC's address is not known; expected --pc ADDRESS:PORT, or link.listen")
    return host, int(port)


def _check_file(text: str) -> None:
    from armgate.links.rsi.ethernet_file import EthernetError, read_ethernet

    try:
        read_ethernet(text.encode())
    except EthernetError as error:
        raise RsiUsageError(f"no KRC could read the file: {error}") from error


def _report(setup: "Setup", survey: "Survey") -> None:
    for line in survey.report():
        typer.echo(printable(line))
    for problem in survey.problems:
        typer.echo(printable(f"WRONG: {problem}"))
    if survey.problems or not survey.sources:
        count = len(survey.problems)
        raise CheckFailedError(f"{count} mismatch(es)" if count else "no telegram came")
    typer.echo(f"{setup.robot}: the KRC fits the cell")


def _robot(configs: list[Path], name: str) -> "tuple[Cell, Robot]":
    from armgate.cell.cell import build_cell
    from armgate.cell.config import load_config
    from armgate.cell.errors import ModelError

    cell = build_cell(load_config(configs))
    try:
        return cell, cell.robot(name)
    except ModelError as error:
        raise RsiUsageError(str(error)) from error


def _flange_in_foot(robot: "Robot") -> "FlangeInFoot":
    """Return the flange in the link that holds the first revolute joint: what a KRC calls ROBROOT."""
    from armgate.cell.urdf import read_urdf

    joints = {joint.name: joint for joint in read_urdf(robot.urdf).joints}
    first = next(joint.name for joint in robot.model.joints if joint.kind != "prismatic")
    foot = joints[first].parent

    def flange(q: "ArrayLike") -> "Placement":
        return robot.model.frame(q, foot).inverse() @ robot.model.frame(q, robot.tool)

    return flange
