"""The link to a KUKA controller (KRC) by its Robot Sensor Interface: see docs/rsi.md."""

from armgate.links.rsi.link import Answer, RsiLink
from armgate.links.rsi.setup import Setup, setup_of, warnings_of
from armgate.links.rsi.shell import RsiDrivenLink
from armgate.links.rsi.states import State

__all__ = ["Answer", "RsiDrivenLink", "RsiLink", "Setup", "State", "setup_of", "warnings_of"]
