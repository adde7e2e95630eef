"""The only caller of the gate. It carries plans to the links, and the links' answers back to the gate."""

from collections.abc import Callable, Mapping
from typing import assert_never

from armgate.events import GateEvent, GateOutput, Plan, Rebase, ResetAnswer, Stopped, Verdict
from armgate.gate import RobotView
from armgate.links.link import Link
from armgate.world.interfaces import Gate

ClientOutput = Verdict | Stopped | ResetAnswer
"""Outputs of the gate that concern clients."""

Tap = Callable[[GateEvent, list[GateOutput]], None]
"""Function that receives every event with the gate's outputs, in order; they suffice for a replay."""


class GateRunner:
    """Runner of the gate, which passes plans and rebases to the links, and their answers back to the gate.

    Args:
        gate: The gate.
        links: Link of each robot.
        tap: Receives every event with its outputs.
    """

    def __init__(self, gate: Gate, links: Mapping[str, Link], tap: Tap | None = None) -> None:
        self._gate = gate
        self._links = links
        self._tap = tap

    def feed(self, event: GateEvent) -> list[ClientOutput]:
        """Process one event, and all answers of links that follow from it.

        Returns:
            The outputs that concern clients, in order.
        """
        for_clients: list[ClientOutput] = []
        events = [event]
        for one in events:  # it grows by the answers of links
            for output in self._step(one):
                match output:
                    case Plan():
                        answer = self._links[output.robot].offer(output)
                        if answer is not None:
                            events.append(answer)
                    case Rebase():
                        self._links[output.robot].rebase(output)
                    case Verdict() | Stopped() | ResetAnswer():
                        for_clients.append(output)
                    case _:
                        assert_never(output)
        return for_clients

    def view(self, robot: str) -> RobotView:
        """Return the gate's view of one robot."""
        return self._gate.view(robot)

    def stops(self, robot: str) -> tuple[int, ...]:
        """Return the ids of the stops in force for a robot, oldest first."""
        return tuple(self._gate.view(robot).stops)

    def warnings(self) -> tuple[str, ...]:
        """Return the gate's warnings."""
        return self._gate.warnings()

    def _step(self, event: GateEvent) -> list[GateOutput]:
        outputs = self._gate.step(event)
        if self._tap is not None:
            self._tap(event, outputs)
        return outputs
