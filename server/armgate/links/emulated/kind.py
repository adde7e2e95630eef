"""Kind of link ``emulated``."""

from typing import TYPE_CHECKING

from armgate.cell.config.link import EmulatedLinkConfig
from armgate.links.kind import SteppedLinkKind

if TYPE_CHECKING:  # a configuration is read without the libraries of a cell
    from armgate.cell.cell import Cell, Robot
    from armgate.links.emulated.link import EmulatedLink


class EmulatedKind(SteppedLinkKind[EmulatedLinkConfig]):
    """Emulated robot that follows its setpoint with a lag."""

    config = EmulatedLinkConfig

    def make_stepped(
        self, own: EmulatedLinkConfig, cell: "Cell", robot: "Robot", start: str
    ) -> "EmulatedLink":
        """Return the link; `robot` has the lags of ``own``, joint by joint."""
        from armgate.links.emulated.link import EmulatedLink  # noqa: PLC0415  (see above)

        return EmulatedLink(robot.name, start, robot.start.tolist(), robot.period, robot.lags)


KIND = EmulatedKind()
