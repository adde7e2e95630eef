"""Link to an emulated robot, in the process of the daemon or of the robot server."""

from armgate.links.emulated.link import EmulatedLink

__all__ = ["EmulatedLink"]
