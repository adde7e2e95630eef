"""``armgate rsi``: what a KRC needs, and what one says."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from armgate.cell.text import printable

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from armgate.cell.cell import Cell, Robot
    from armgate.cell.placement import Placement
    from armgate.links.rsi.commissioning.axis_directions import Foot
    from armgate.links.rsi.commissioning.survey import Survey
    from armgate.links.rsi.setup import Setup

rsi = typer.Typer(
    no_args_is_help=True, add_completion=False, help="Bring a KUKA controller and a cell together."
)

Configs = Annotated[list[Path], typer.Argument(metavar="CONFIG...", help="Cell files; later ones overlay.")]
RobotName = Annotated[str, typer.Option(metavar="NAME", help="Which robot of the cell; its link is rsi.")]


class CalledWronglyError(Exception):
    """The command was called wrongly; nothing was written."""

    exit_code = 2


class CheckFailedError(Exception):
    """The KRC and the cell do not fit each other."""


@rsi.command()
def config(
    configs: Configs,
    *,
    robot: RobotName,
    pc: Annotated[
        str | None, typer.Option(metavar="ADDRESS:PORT", help="This PC as the KRC sees it; else link.listen.")
    ] = None,
    generation: Annotated[
        Literal["rsi2", "rsi3"], typer.Option(help="rsi2: KRC2. rsi3: KRC4, KRC5.")
    ] = "rsi3",
    sentype: Annotated[str, typer.Option(help="How replies call themselves.")] = "armgate",
    out: Annotated[Path, typer.Option(help="Folder to write to.")] = Path(),
    force: Annotated[bool, typer.Option("--force", help="Overwrite files that are there.")] = False,
) -> None:
    """Write the RSI Ethernet file and a KRL program that match a robot of a cell."""
    from armgate.cell.link_config import RsiLinkConfig
    from armgate.links.rsi.commissioning import krl
    from armgate.links.rsi.ethernet_file import EthernetError, read_ethernet
    from armgate.links.rsi.setup import joint_axes

    _, found = _robot(configs, robot)
    link = found.config.link
    if not isinstance(link, RsiLinkConfig):
        raise CalledWronglyError(f"{robot} has a link of kind {link.kind}; expected rsi")
    host, _, port = (pc or link.listen or "").rpartition(":")
    if not (host and port.isascii() and port.isdigit()):
        raise CalledWronglyError("the PC's address is not known; expected --pc ADDRESS:PORT, or link.listen")
    axes = joint_axes(found, link)
    text = krl.ethernet_xml(axes, host, int(port), sentype, link.mode == "relative", generation)
    try:
        read_ethernet(text.encode())
    except EthernetError as error:
        raise CalledWronglyError(f"no KRC could read that: {error}") from error
    files = {
        out / Path(link.ethernet).name: text,
        out / "armgate_rsi.src": krl.program(axes, link, found.period, generation),
    }
    for path in files:
        if path.exists() and not force:
            raise CalledWronglyError(f"{path} is there already; expected --force, or another --out")
    for path, text in files.items():
        path.write_text(text, encoding="utf-8")
        typer.echo(f"written: {path}")


@rsi.command()
def check(
    configs: Configs,
    robot: RobotName,
    seconds: Annotated[float, typer.Option(min=0.1, help="How long to listen, s.")] = 5.0,
    wait: Annotated[float, typer.Option(min=0.1, help="How long to wait for the first telegram, s.")] = 60.0,
) -> None:
    """Listen to a KRC, never answer, and report what it says against the cell.

    It breaks off by itself after Timeout cycles, unless its file says ONLYSEND TRUE.
    """
    import asyncio

    from armgate.links.rsi.commissioning.survey import Survey
    from armgate.links.rsi.setup import setup_of
    from armgate.links.rsi.udp import listen

    cell, found = _robot(configs, robot)
    setup = setup_of(cell, found)
    survey = Survey(setup, _foot(found))
    told = f"armgate: listens on {setup.listen[0]}:{setup.listen[1]}, and never answers"
    asyncio.run(listen(setup.listen, survey.take, seconds, wait, lambda: typer.echo(told, err=True)))
    _tell(setup, survey)


def _tell(setup: "Setup", survey: "Survey") -> None:
    for line in survey.report():
        typer.echo(printable(line))
    for problem in survey.problems:
        typer.echo(printable(f"WRONG: {problem}"))
    if survey.problems or not survey.sources:
        count = len(survey.problems)
        raise CheckFailedError(f"{count} thing(s) do not fit" if count else "nothing came")
    typer.echo(f"{setup.robot}: the KRC fits the cell")


def _robot(configs: list[Path], name: str) -> "tuple[Cell, Robot]":
    from armgate.cell.cell import build_cell
    from armgate.cell.config import load_config
    from armgate.cell.errors import ModelError

    cell = build_cell(load_config(configs))
    try:
        return cell, cell.robot(name)
    except ModelError as error:
        raise CalledWronglyError(str(error)) from error


def _foot(robot: "Robot") -> "Foot":
    """The flange in the link that holds the first turning joint: what a KRC calls ROBROOT."""
    from armgate.cell.urdf import read_urdf

    joints = {joint.name: joint for joint in read_urdf(robot.urdf).joints}
    first = next(joint.name for joint in robot.model.joints if joint.kind != "prismatic")
    foot = joints[first].parent

    def place(q: "ArrayLike") -> "Placement":
        return robot.model.frame(q, foot).inverse() @ robot.model.frame(q, robot.tool)

    return place
