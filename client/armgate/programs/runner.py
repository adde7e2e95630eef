"""Runs of tick programs in a world."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial

from armgate.client.program import Outcome
from armgate.programs.participant import Controller, Participant
from armgate.world import World

Report = Callable[[str, str], object]
"""Function that receives a participant's name and a line for users."""


def ignore(_name: str, _text: str) -> None:
    """Print nothing."""


class WorldRun:
    """Run of programs in a world, step by step.

    Args:
        world: The world; the controllers are its participants.
        controllers: The participants by name. They join in this order.
        until: Names of the participants whose end ends the run; all of them if empty.
        report: Receives lines for users.

    Attributes:
        world: The world.
        participants: The participants by name.

    Raises:
        ValueError: ``until`` names other participants.
        ClientError: A lease or a subscription was refused.
    """

    def __init__(
        self,
        world: World,
        controllers: Mapping[str, Controller],
        until: Sequence[str] = (),
        report: Report = ignore,
    ) -> None:
        if strange := set(until) - set(controllers):
            names = ", ".join(controllers)
            raise ValueError(f"until: no participant {', '.join(sorted(strange))}; expected {names}")
        self.world = world
        self.participants = {
            name: Participant(world, name, controller, partial(report, name))
            for name, controller in controllers.items()
        }
        self._until = tuple(until) or tuple(controllers)

    @property
    def ended(self) -> bool:
        """True if the participants that the run waits for have ended."""
        return all(self.participants[name].outcome is not None for name in self._until)

    @property
    def outcomes(self) -> dict[str, Outcome | None]:
        """Outcomes by participant; None for a participant that has not ended."""
        return {name: one.outcome for name, one in self.participants.items()}

    def step(self) -> bool:
        """Let all programs act, then step the world, unless the run ends.

        Returns:
            True if the world was stepped, False if the run has ended.
        """
        for participant in self.participants.values():
            participant.act()
        if self.ended:
            return False
        self.world.step()
        for participant in self.participants.values():
            participant.take()
        return True

    def close(self) -> None:
        """End the sessions of all participants; their robots brake along their plans."""
        for participant in self.participants.values():
            participant.leave()


def run(
    world: World,
    controllers: Mapping[str, Controller],
    *,
    until: Sequence[str] = (),
    seconds: float | None = None,
    observe: Callable[[], object] = lambda: None,
    report: Report = ignore,
) -> dict[str, Outcome | None]:
    """Run programs in a world until they have ended or a time has passed.

    Args:
        world: The world; the controllers are its participants.
        controllers: The participants by name.
        until: Names of the participants whose end ends the run; all of them if empty.
        seconds: Virtual time after which the run ends, s; None: without limit.
        observe: Called after each step.
        report: Receives lines for users.

    Returns:
        The outcomes; None for a participant that had not ended.

    Raises:
        ValueError: ``until`` names other participants.
        ClientError: A lease or a subscription was refused.
        Exception: Any error of a program; the sessions of all participants are ended before.
    """
    running = WorldRun(world, controllers, until, report)
    begin = world.time
    try:
        while (seconds is None or world.time - begin < seconds) and running.step():
            observe()
        return running.outcomes
    finally:
        running.close()
