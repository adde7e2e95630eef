"""World of one episode, with the agent and the programs of other robots as its participants."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armgate.cell.cell import Cell
from armgate.client.program import Program, ProgramContext
from armgate.env.actions import Actions
from armgate.env.seat import Seat
from armgate.env.transition import ArmState
from armgate.programs import Controller, Participant
from armgate.protocol.messages import Verdict
from armgate.world import RunRecorder, World

Array = NDArray[np.float64]

AGENT = "agent"
"""Name of the agent as a participant."""


MakeProgram = Callable[[ProgramContext], Program]
"""Function that makes the program of a robot for each episode, see `armgate.client.program`."""


@dataclass(frozen=True)
class Cast:
    """Division of a cell's robots.

    Attributes:
        cell: The cell.
        agent: Robots that the agent commands.
        driven: Robots that programs command; the remaining ones rest.
    """

    cell: Cell
    agent: tuple[str, ...]
    driven: tuple[str, ...]

    @property
    def participants(self) -> list[str]:
        """Names of the participants of its worlds."""
        return [AGENT, *map(program_name, self.driven)]


class Episode:
    """World in which the agent holds its robots.

    Args:
        cast: Division of the cell's robots.
        recorders: Record the world.
        compiled: Form of the gate's kernels, as for `World`.

    Attributes:
        world: The world.
        programs: Participants that command other robots, by robot; none until `add_programs`.
    """

    def __init__(
        self, cast: Cast, recorders: Sequence[RunRecorder] = (), compiled: bool | None = None
    ) -> None:
        self.world = World(cast.cell, cast.participants, recorders=recorders, compiled=compiled)
        self.programs: dict[str, Participant] = {}
        self._agent = Seat(self.world, AGENT, cast.agent)
        self._robots = cast.agent
        self._slowest = max(cast.agent, key=lambda name: cast.cell.robot(name).period)
        self._setpoints: dict[str, tuple[int, Array]] = {}
        self._increments: dict[str, Array] = {}
        self._note()

    def add_programs(self, programs: Mapping[str, MakeProgram]) -> None:
        """Let programs command other robots from now on."""
        for robot, make in programs.items():
            controller = Controller(make, robot)
            self.programs[robot] = Participant(self.world, program_name(robot), controller, _ignore)

    # --- copies -------------------------------------------------------------------------------------------

    def __getstate__(self) -> dict[str, object]:
        """Return the state with the world as saved bytes."""
        return {**vars(self), "world": self.world.save()}

    def resume(self, cell: Cell) -> None:
        """Complete an unpickled episode: restore its world of this cell."""
        saved = self.world
        assert isinstance(saved, bytes)
        self.world = World.restored(cell, saved)
        self._agent.rejoin(self.world)
        for program in self.programs.values():
            program.rejoin(self.world)

    # --- steps --------------------------------------------------------------------------------------------

    def step(self, actions: Actions, wanted: Mapping[str, Array]) -> list[Verdict]:
        """Command until the agent's slowest robot has ticked; return the verdicts on the agent's commands.

        Args:
            actions: Bounds of the increments.
            wanted: Wanted increments by robot (n,), rad or m.
        """
        verdicts: list[Verdict] = []
        before = self._agent.entry(self._slowest).tick
        while self._agent.entry(self._slowest).tick == before:
            for robot in self._robots:
                if robot in self._agent.ticked:
                    setpoint = self._setpoints[robot][1]
                    last = self._increments[robot]
                    self._agent.send(robot, actions.increment(robot, wanted[robot], last, setpoint))
            for program in self.programs.values():
                program.act()
            self.world.step()
            for program in self.programs.values():
                program.take()
            verdicts += self._agent.receive()
            self._note()
        return verdicts

    def _note(self) -> None:
        """Compute the increment that each robot played last, from its setpoints."""
        for entry in self._agent.state.entries:
            setpoint = np.array(entry.setpoint)
            tick, last = self._setpoints.get(entry.robot, (entry.tick, setpoint))
            if entry.tick > tick or entry.robot not in self._setpoints:
                self._increments[entry.robot] = (setpoint - last) / max(1, entry.tick - tick)
                self._setpoints[entry.robot] = entry.tick, setpoint

    @property
    def outcomes(self) -> dict[str, str]:
        """Outcomes of the programs in words, by robot; "" while one runs."""
        return {
            robot: "" if program.outcome is None else program.outcome.text
            for robot, program in self.programs.items()
        }

    @property
    def arms(self) -> dict[str, ArmState]:
        """States of all robots by name."""
        return {
            entry.robot: ArmState.at(entry, self._increments[entry.robot].copy())
            for entry in self._agent.state.entries
        }


def program_name(robot: str) -> str:
    """Return the name of the participant that commands a robot by a program."""
    return f"program-{robot}"


def _ignore(_text: str) -> None:
    """Print nothing."""
