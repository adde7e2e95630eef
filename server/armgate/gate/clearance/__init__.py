"""Clearance: proven lower bounds of distances between occupancies, for every timing of the robots."""

from armgate.gate.clearance.clearance import Clearance, ClearanceResult

__all__ = ["Clearance", "ClearanceResult"]
