"""Observer of the kit: a connection without faults that receives every state during a whole run."""

import asyncio
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import suppress

from armgate.conformance.case import Violation
from armgate.conformance.codec import Fields
from armgate.conformance.command_log import CommandLog
from armgate.conformance.connection import Connection
from armgate.conformance.safety_checks import JointBounds, Sample, is_at_rest, unsafe_motion

_KEPT = 20_000
_FINDINGS = 8
_FIRST = 2.0
"""Time in which the first state of each robot must come, s."""


class Observer:
    """Client that receives every state of every robot.

    Args:
        connection: A connection after the welcome.
        description: The cell.

    Attributes:
        entries: The newest entry of each robot.
        gap: The longest time between two states since ``begin_case``, s.
    """

    def __init__(self, connection: Connection, description: Fields) -> None:
        self.connection = connection
        self.entries: dict[str, Fields] = {}
        self._bounds = {robot["name"]: JointBounds.of(robot) for robot in description["robots"]}
        self._seen: dict[str, list[Sample]] = defaultdict(list)
        self._news = asyncio.Event()
        self._task: asyncio.Task[None] | None = None
        self._last = 0.0
        self.gap = 0.0

    async def start(self) -> None:
        """Subscribe, and receive states from now on.

        Raises:
            Violation: The server does not accept the subscription of an observer.
        """
        await self.connection.call("subscribe", "subscribed", every=1)
        self._task = asyncio.create_task(self._receive_states())
        # In lock-step no tick happens before all participants are connected; the newest states come at once.
        with suppress(Violation):  # A robot whose link is not ready may never tick, and has no entry.
            await self.until(lambda: len(self.entries) == len(self._bounds), "every robot's entry", _FIRST)
        await self.until(lambda: bool(self.entries), "a state")

    async def close(self) -> None:
        """Stop receiving states, and close the connection."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.wait([self._task])
        self.connection.close()

    @property
    def disconnected(self) -> bool:
        """True if the connection is lost."""
        return self.connection.ended

    def begin_case(self) -> None:
        """Forget what was seen before this case, except the last two states."""
        self.gap = 0.0
        for robot, samples in self._seen.items():
            self._seen[robot] = samples[-2:]

    def findings(self, commands: CommandLog) -> list[str]:
        """Return the unsafe motions of robots since ``begin_case``."""
        return [
            finding
            for robot, samples in self._seen.items()
            for finding in unsafe_motion(robot, samples, self._bounds[robot], commands)
        ][:_FINDINGS]

    def samples(self, robot: str) -> list[Sample]:
        """Return the states of a robot since ``begin_case``."""
        return self._seen[robot]

    async def until(self, condition: Callable[[], bool], what: str, within: float | None = None) -> None:
        """Wait until a condition on the received states is true.

        Raises:
            Violation: It does not become true in time.
        """
        seconds = self.connection.timeout if within is None else within
        try:
            async with asyncio.timeout(seconds):
                while not condition():
                    if self.disconnected:
                        raise Violation("the server closed the connection of the observer")
                    self._news.clear()
                    await self._news.wait()
        except TimeoutError:
            raise Violation(f"the observer waited {seconds:g} s for {what}") from None

    async def ticks(self, robot: str, count: int) -> None:
        """Wait until a robot has ticked ``count`` more times."""
        goal = self.tick(robot) + count
        await self.until(lambda: self.tick(robot) >= goal, f"{count} ticks of {robot}")

    def tick(self, robot: str) -> int:
        """Return the newest tick received from a robot."""
        return int(self.entries[robot]["tick"])

    def is_at_rest(self, robot: str) -> bool:
        """Return True if the newest states show a robot at rest."""
        return is_at_rest(self._seen[robot])

    def disturbances(self) -> Iterator[str]:
        """Yield the leases that are still held after a case, and the robots that still move."""
        for robot, entry in self.entries.items():
            if entry["holder"] is not None:
                yield f"{robot} is still held by {entry['holder']}"
            if not self.is_at_rest(robot):
                yield f"{robot} still moves"

    def stops(self) -> set[int]:
        """Return the ids of the stops in force."""
        return {stop for entry in self.entries.values() for stop in entry["stops"] or ()}

    async def _receive_states(self) -> None:
        while True:
            try:
                state = await self.connection.receive(lambda m: m["type"] == "state", "a state", within=1e9)
            except Violation:
                self._news.set()
                return
            now = asyncio.get_running_loop().time()
            self._last, self.gap = now, max(self.gap, now - (self._last or now))
            for entry in state["entries"]:
                self.entries[entry["robot"]] = entry
                if entry["robot"] == state["robot"]:
                    self._add_sample(entry)
            self._news.set()

    def _add_sample(self, entry: Fields) -> None:
        samples = self._seen[entry["robot"]]
        if entry.get("setpoint") and not (samples and samples[-1].tick >= entry["tick"]):
            samples.append(Sample.of(entry))
            del samples[:-_KEPT]
