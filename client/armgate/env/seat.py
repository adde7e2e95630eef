"""Seat: a participant of a world that holds robots, and the newest states of the cell."""

from collections.abc import Iterable, Sequence

import numpy as np

from armgate.env.errors import EnvError
from armgate.protocol import messages as m
from armgate.world import World


class Seat:
    """Participant that has acquired some robots and subscribes to all states.

    Args:
        world: The world, in its first step.
        name: Name of the participant.
        robots: Robots to acquire.

    Attributes:
        name: Name of the participant.
        state: Newest state of the cell.
        ticked: Robots that have ticked since the last call of `send` for them.

    Raises:
        EnvError: The world sent no state, or an error.
    """

    def __init__(self, world: World, name: str, robots: Sequence[str]) -> None:
        self.name = name
        self.ticked: set[str] = set()
        self._client = world.join(name)
        self._fences: dict[str, int] = {}
        for robot in robots:
            lease = self._client.request(m.Acquire(robot=robot))
            assert isinstance(lease, m.Lease)
            self._fences[robot] = lease.fence
        self._client.request(m.Subscribe())
        self.state: m.State
        self.receive()
        if not hasattr(self, "state"):
            raise EnvError(f"{name}: the world has sent no state; join it in its first step")

    def rejoin(self, world: World) -> None:
        """Continue in a copy of the world."""
        self._client = world.client(self.name)

    def __getstate__(self) -> dict[str, object]:
        """Return everything but the client, which belongs to one world; see `rejoin`."""
        return {key: value for key, value in vars(self).items() if key != "_client"}

    def entry(self, robot: str) -> m.Entry:
        """Return the newest entry of a robot."""
        for entry in self.state.entries:
            if entry.robot == robot:
                return entry
        raise EnvError(f"no robot {robot} in the state")

    def send(self, robot: str, dq: Iterable[float]) -> None:
        """Send the increment of a robot for its next tick (n,), rad or m."""
        tick = self.entry(robot).tick
        self.ticked.discard(robot)
        command = m.Command(
            robot=robot, fence=self._fences[robot], seq=tick, tick=tick, dq=tuple(np.asarray(dq).tolist())
        )
        self._client.send(command)

    def receive(self) -> list[m.Verdict]:
        """Take all messages: keep the newest state, return the verdicts in order.

        Raises:
            EnvError: The world answered with an error.
        """
        verdicts = []
        for message in self._client.take():
            if isinstance(message, m.State):
                self.state = message
                self.ticked.add(message.robot)
            elif isinstance(message, m.Verdict):
                verdicts.append(message)
            elif isinstance(message, m.Error):
                raise EnvError(f"{self.name}: {message.code}: {message.text}")
        return verdicts
