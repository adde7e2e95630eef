"""The link to a KUKA controller (KRC) by its Robot Sensor Interface: see docs/rsi.md."""

from armgate.links.rsi.link import Answer, RsiLink
from armgate.links.rsi.setup import Setup, setup_of, warnings_of
from armgate.links.rsi.states import State
from armgate.links.rsi.udp_link import RsiUdpLink

__all__ = ["Answer", "RsiLink", "RsiUdpLink", "Setup", "State", "setup_of", "warnings_of"]
