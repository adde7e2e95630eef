"""Events and outputs of the gate: plain data, shared by links, daemon, gate and recordings.

Every value is immutable and holds only numbers, texts and tuples, so that an event log can be written,
compared and replayed. Increments and positions are in rad (revolute) and m (prismatic), times in s.

The path of one increment: the gate answers a ``Command`` with a ``Verdict``. If the command was admitted or
limited, a ``Plan`` goes to the robot's link, which answers with a ``PlanAnswer`` and plays the plan, one
increment per ``Tick``.
"""

from armgate.events.gate import (
    Cause,
    Command,
    GateEvent,
    GateOutput,
    LeaseChange,
    Nearest,
    Outcome,
    Point,
    Reason,
    Reset,
    ResetAnswer,
    Stop,
    Stopped,
    Verdict,
)
from armgate.events.link import (
    Joints,
    LinkChange,
    LinkState,
    Plan,
    PlanAnswer,
    PlanKey,
    Rebase,
    Tick,
)

__all__ = [
    "Cause",
    "Command",
    "GateEvent",
    "GateOutput",
    "Joints",
    "LeaseChange",
    "LinkChange",
    "LinkState",
    "Nearest",
    "Outcome",
    "Plan",
    "PlanAnswer",
    "PlanKey",
    "Point",
    "Reason",
    "Rebase",
    "Reset",
    "ResetAnswer",
    "Stop",
    "Stopped",
    "Tick",
    "Verdict",
]
