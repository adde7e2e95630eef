"""The daemon logs as the robot server does."""

from armgate.links.log import Log

__all__ = ["Log"]
