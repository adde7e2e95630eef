"""Safety gate: decides about every command; pure and deterministic, without clock, socket or randomness.

``Gate.step(event)`` takes ticks, commands, plan answers, stops, resets, lease and link changes. It returns
verdicts, plans and answers to stops and resets. In the literature it is called the System Integrity Module.

The path of a command through the package: ``gate`` → ``command_checks`` (lease, stop, link, age) →
``decision``. It calls ``joint_limits`` (speed, acceleration, position), ``retreat`` (ways out of a violated
limit), ``braking`` (the increments of the stop), ``occupancy`` (what the robot can reach until rest) and
``clearance``. ``gate`` then makes the plan, and ``reservations`` keeps what was proven for it.
``verdict_wording`` contains the texts of all verdicts.
"""

from armgate.gate.clearance.compiled import prepare
from armgate.gate.clearance.nearest_pairs import start_clearances
from armgate.gate.clearance.support import support, support_table
from armgate.gate.gate import Gate
from armgate.gate.robot import RobotView

__all__ = [
    "Gate",
    "RobotView",
    "prepare",
    "start_clearances",
    "support",
    "support_table",
]
