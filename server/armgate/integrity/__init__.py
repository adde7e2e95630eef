"""The System Integrity Module's judgement: pure, deterministic, without clock, socket or randomness.

``Gate.step(event)`` takes ticks, commands, acknowledgements, stops and lease changes and returns verdicts
and plans.
"""

from armgate.integrity.beside import GateBeside, Intended
from armgate.integrity.gate import Gate
from armgate.integrity.nearest import start_clearances
from armgate.integrity.replay import replay
from armgate.integrity.support import support, support_table
from armgate.integrity.view import RobotView

__all__ = [
    "Gate",
    "GateBeside",
    "Intended",
    "RobotView",
    "replay",
    "start_clearances",
    "support",
    "support_table",
]
