"""The kit's own eye: a connection that only looks on, past every fault, through a whole run."""

import asyncio
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import suppress

from armgate.conformance.ledger import Ledger
from armgate.conformance.packing import Fields
from armgate.conformance.safety import Joints, Sample, at_rest, judge
from armgate.conformance.verdicts import Unmet
from armgate.conformance.wire import Wire

_KEPT = 20_000
_FINDINGS = 8
_FIRST = 2.0
"""How long the first state of each robot may take, s."""


class Observer:
    """Sees every state of every robot.

    Args:
        wire: A welcomed connection.
        description: The cell.

    Attributes:
        entries: The newest entry of each robot.
        gap: The longest time between two states since ``begin``, s.
    """

    def __init__(self, wire: Wire, description: Fields) -> None:
        self.wire = wire
        self.entries: dict[str, Fields] = {}
        self._joints = {robot["name"]: Joints.of(robot) for robot in description["robots"]}
        self._seen: dict[str, list[Sample]] = defaultdict(list)
        self._news = asyncio.Event()
        self._task: asyncio.Task[None] | None = None
        self._last = 0.0
        self.gap = 0.0

    async def watch(self) -> None:
        """Subscribe and look on from now.

        Raises:
            Unmet: The server does not subscribe an observer.
        """
        await self.wire.answered("subscribe", "subscribed", every=1)
        self._task = asyncio.create_task(self._look())
        # (lock-step: nothing ticks before its participants are there, but the newest states come at once)
        with suppress(Unmet):  # (one whose link is not ready may never tick, and have no entry)
            await self.until(lambda: len(self.entries) == len(self._joints), "every robot's entry", _FIRST)
        await self.until(lambda: bool(self.entries), "a state")

    async def close(self) -> None:
        """Look on no more."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.wait([self._task])
        self.wire.close()

    @property
    def blind(self) -> bool:
        """Whether the connection is gone."""
        return self.wire.ended

    def begin(self) -> None:
        """A case begins: what was seen before is told no more, but for the last two states."""
        self.gap = 0.0
        for robot, samples in self._seen.items():
            self._seen[robot] = samples[-2:]

    def findings(self, ledger: Ledger) -> list[str]:
        """What was wrong with what robots did since ``begin``."""
        return [
            finding
            for robot, samples in self._seen.items()
            for finding in judge(robot, samples, self._joints[robot], ledger)
        ][:_FINDINGS]

    def samples(self, robot: str) -> list[Sample]:
        """What was seen of a robot since ``begin``."""
        return self._seen[robot]

    async def until(self, holds: Callable[[], bool], what: str, within: float | None = None) -> None:
        """Wait until something holds of what was seen.

        Raises:
            Unmet: It does not in time.
        """
        patience = self.wire.patience if within is None else within
        try:
            async with asyncio.timeout(patience):
                while not holds():
                    if self.blind:
                        raise Unmet("the server closed the connection of the observer")
                    self._news.clear()
                    await self._news.wait()
        except TimeoutError:
            raise Unmet(f"the observer waited {patience:g} s for {what}") from None

    async def ticks(self, robot: str, count: int) -> None:
        """Wait until a robot has ticked so often from now."""
        goal = self.tick(robot) + count
        await self.until(lambda: self.tick(robot) >= goal, f"{count} ticks of {robot}")

    def tick(self, robot: str) -> int:
        """The newest tick seen of a robot."""
        return int(self.entries[robot]["tick"])

    def rests(self, robot: str) -> bool:
        """Whether a robot was seen at rest."""
        return at_rest(self._seen[robot])

    def unrest(self) -> Iterator[str]:
        """What is not yet as before a case: leases held, stops in force, motion."""
        for robot, entry in self.entries.items():
            if entry["holder"] is not None:
                yield f"{robot} is still held by {entry['holder']}"
            if not self.rests(robot):
                yield f"{robot} still moves"

    def stops(self) -> set[int]:
        """The stops in force."""
        return {stop for entry in self.entries.values() for stop in entry["stops"] or ()}

    async def _look(self) -> None:
        while True:
            try:
                state = await self.wire.hear(lambda m: m["type"] == "state", "a state", within=1e9)
            except Unmet:
                self._news.set()
                return
            now = asyncio.get_running_loop().time()
            self._last, self.gap = now, max(self.gap, now - (self._last or now))
            for entry in state["entries"]:
                self.entries[entry["robot"]] = entry
                if entry["robot"] == state["robot"]:
                    self._note(entry)
            self._news.set()

    def _note(self, entry: Fields) -> None:
        samples = self._seen[entry["robot"]]
        if entry.get("setpoint") and not (samples and samples[-1].tick >= entry["tick"]):
            samples.append(Sample.of(entry))
            del samples[:-_KEPT]
