"""The System Integrity Module's judgement: pure, deterministic, without clock, socket or randomness.

``Gate.step(event)`` takes ticks, commands, acknowledgements, stops and lease changes and returns verdicts
and plans.
"""

from armgate.integrity.beside import GateBeside
from armgate.integrity.gate import Gate
from armgate.integrity.nearest import start_clearances
from armgate.integrity.replay import replay
from armgate.integrity.view import RobotView

__all__ = ["Gate", "GateBeside", "RobotView", "replay", "start_clearances"]
