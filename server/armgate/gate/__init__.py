"""The System Integrity Module's judgement: pure, deterministic, without clock, socket or randomness.

``Gate.step(event)`` takes ticks, commands, acknowledgements, stops and lease changes and returns verdicts
and plans.
"""

from armgate.gate.beside import GateBeside, Intended
from armgate.gate.gate import Gate
from armgate.gate.nearest import start_clearances
from armgate.gate.replay import replay
from armgate.gate.support import support, support_table
from armgate.gate.view import RobotView

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
