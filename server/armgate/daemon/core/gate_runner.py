"""The one place where the gate is asked."""

from collections import deque
from collections.abc import Callable, Mapping
from typing import Protocol

from armgate.events import GateEvent, GateOutput, Plan, PlanAnswer, Rebase, ResetAnswer, Stopped, Verdict
from armgate.gate import RobotView

ClientOutput = Verdict | Stopped | ResetAnswer
"""What of the gate's outputs concerns clients."""

Tap = Callable[[GateEvent, list[GateOutput]], None]
"""Sees every event with the gate's outputs, in order: together they are a replay."""


class Judge(Protocol):
    """What the daemon needs of the gate."""

    def step(self, event: GateEvent) -> list[GateOutput]:
        """Judge one event."""

    def view(self, robot: str) -> RobotView:
        """What is known of one robot."""

    def warnings(self) -> tuple[str, ...]:
        """What is worth saying beside the robots."""


class Carrier(Protocol):
    """What the daemon needs of a link."""

    def offer(self, plan: Plan) -> PlanAnswer | None:
        """Replace the held plan; None if the answer comes later, as an event."""

    def rebase(self, rebase: Rebase) -> None:
        """Drop the plan and take the given setpoint as the commanded position."""


class GateRunner:
    """Feeds the gate and carries its plans and rebases to the links, whose answers are events again.

    Args:
        judge: The gate.
        links: Each robot's link.
        tap: Told of every event and its outputs.
    """

    def __init__(self, judge: Judge, links: Mapping[str, Carrier], tap: Tap | None = None) -> None:
        self._judge = judge
        self._links = links
        self._tap = tap

    def feed(self, event: GateEvent) -> list[ClientOutput]:
        """Have one event judged, and everything that follows from it at the links.

        Returns:
            What clients are to be told, in order.
        """
        told: list[ClientOutput] = []
        events = deque([event])
        while events:
            event = events.popleft()
            outputs = self._judge.step(event)
            if self._tap is not None:
                self._tap(event, outputs)
            for output in outputs:
                if isinstance(output, Plan):
                    answer = self._links[output.robot].offer(output)
                    if answer is not None:
                        events.append(answer)
                elif isinstance(output, Rebase):
                    self._links[output.robot].rebase(output)
                else:
                    told.append(output)
        return told

    def view(self, robot: str) -> RobotView:
        """What the gate knows of one robot."""
        return self._judge.view(robot)

    def warnings(self) -> tuple[str, ...]:
        """What the gate warns of."""
        return self._judge.warnings()
