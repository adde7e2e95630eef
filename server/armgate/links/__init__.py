"""The Robot Server: plans, one link interface, the emulated robot behind it."""

from armgate.links.emulated import EmulatedLink
from armgate.links.link import Emit, Link, LinkEvent, SelfClockedLink, SteppedLink
from armgate.links.plan_player import PlanPlayer, Played

__all__ = [
    "Emit",
    "EmulatedLink",
    "Link",
    "LinkEvent",
    "PlanPlayer",
    "Played",
    "SelfClockedLink",
    "SteppedLink",
]
