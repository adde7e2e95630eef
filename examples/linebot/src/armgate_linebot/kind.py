"""Kind of link ``linebot``: the model of its configuration, and the factory of its link."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field

from armgate.cell.config.fields import Period
from armgate.cell.config.link import LinkConfig
from armgate.links.kind import LinkContext, LinkKind, LinkReport, VirtualRobot

if TYPE_CHECKING:
    from armgate.cell.cell import Cell, Robot
    from armgate.cell.config import CellConfig
    from armgate_linebot.link import LinebotLink


class LinebotConfig(LinkConfig):
    """Robot that sends lines of text over TCP."""

    UNHASHED: ClassVar[frozenset[str]] = frozenset({"host", "port"})

    kind: Literal["linebot"]
    host: str = "127.0.0.1"
    """Address of the robot."""
    port: Annotated[int, Field(ge=1, le=65535)]
    """Port of the robot."""
    silence: Period = 0.2
    """Time without a line after which the robot is lost [s]."""
    virtual: bool = False
    """True if the virtual robot replaces the real one when a command starts the whole cell."""


class LinebotKind(LinkKind[LinebotConfig]):
    """Robot with a clock of its own, reached over TCP."""

    config = LinebotConfig

    def check(self, own: LinebotConfig, cell: "Cell", robot: "Robot") -> LinkReport:
        """Check what the model alone cannot check, and describe the link."""
        if own.silence < 2.0 * robot.period:
            raise cell.config.error(
                ("robots", robot.name, "link", "silence"),
                f"{own.silence:g} s; expected at least two periods ({2.0 * robot.period:g} s)",
            )
        return LinkReport([f"lines of text over TCP, robot at {own.host}:{own.port}"])

    def make(self, own: LinebotConfig, cell: "Cell", robot: "Robot", context: LinkContext) -> "LinebotLink":
        """Return the link; it connects when the robot server opens it."""
        from armgate_linebot.link import LinebotLink

        self.check(own, cell, robot)
        return LinebotLink(own, robot.name, robot.model.n, context)

    def virtual(
        self, own: LinebotConfig, config: "CellConfig", robot: str, files: Sequence[Path], logs: Path
    ) -> VirtualRobot | None:
        """Return the virtual robot: ``armgate linebot``."""
        if not own.virtual:
            return None
        return VirtualRobot(f"linebot-{robot}", ["linebot", *map(str, files), "--robot", robot])


KIND = LinebotKind()
