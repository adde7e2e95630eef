"""Kind of link ``rsi``."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from armgate.cell.config.link_kinds import VirtualRobot
from armgate.links.kind import LinkContext, LinkKind, LinkReport
from armgate.links.rsi.config import AxisGroup, RsiLinkConfig

if TYPE_CHECKING:  # a configuration is read without the libraries of a cell
    from armgate.cell.cell import Cell, Robot
    from armgate.cell.config import CellConfig
    from armgate.links.rsi.udp_link import RsiUdpLink


class RsiKind(LinkKind[RsiLinkConfig]):
    """KUKA robot that its KRC moves by the Robot Sensor Interface."""

    config = RsiLinkConfig

    def check(self, own: RsiLinkConfig, cell: "Cell", robot: "Robot") -> LinkReport:
        """Check the configuration against the KRC's own file."""
        from armgate.links.rsi.setup import setup_of, warnings_of  # noqa: PLC0415  (see above)

        setup = setup_of(cell, robot)
        axes = ", ".join(f"{axis.name} {axis.joint}" for axis in setup.axes)
        host, port = setup.listen
        line = f"by RSI with the KRC at {setup.krc}, answered at {host}:{port}; axes {axes}"
        return LinkReport([line], warnings_of(setup))

    def make(self, own: RsiLinkConfig, cell: "Cell", robot: "Robot", context: LinkContext) -> "RsiUdpLink":
        """Return the link, which listens for the KRC's telegrams once it is opened."""
        from armgate.links.rsi.setup import setup_of  # noqa: PLC0415
        from armgate.links.rsi.udp_link import RsiUdpLink  # noqa: PLC0415

        return RsiUdpLink(setup_of(cell, robot), context.start, context.note, context.now)

    def virtual(
        self, own: RsiLinkConfig, config: "CellConfig", robot: str, files: Sequence[Path], logs: Path
    ) -> VirtualRobot | None:
        """Return ``armgate krc`` with the profile that the configuration names."""
        if own.virtual is None or own.listen is None:
            return None
        name = f"krc-{robot}"
        ethernet = config.file(("robots", robot, "link", "ethernet"), own.ethernet)
        command = ["krc", "--profile", own.virtual, "--config", str(ethernet), "--robot", robot]
        command += [word for file in files for word in ("--cell", str(file))]
        period = config.robots[robot].period
        command += ["--to", own.listen, "--cycle", f"{1000 * period:g}", "--mode", own.mode]
        command += ["--precision", str(own.precision), "--timeout", str(own.timeout)]
        if own.axiscorr is not None:
            # AXISCORR limits every correction to less than the wider AXISCORRMON.
            command += ["--axiscorr", _limits(own.axiscorr, 0.0), "--axiscorrmon", _limits(own.axiscorr, 1.0)]
        return VirtualRobot(name, [*command, "--trace", str(logs / f"{name}.csv")])


def _limits(axiscorr: Mapping[AxisGroup, float], more: float) -> str:
    return ",".join(f"{axis}={limit + more:g}" for axis, limit in axiscorr.items())


KIND = RsiKind()
