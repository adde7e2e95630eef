"""The Robot Server: plans, one link interface, the emulated robot behind it."""

from armgate.links.emulated import EmulatedLink
from armgate.links.link import ClockedLink, DrivenLink, Emit, Link, LinkEvent
from armgate.links.player import PlanPlayer, Played

__all__ = ["ClockedLink", "DrivenLink", "Emit", "EmulatedLink", "Link", "LinkEvent", "PlanPlayer", "Played"]
