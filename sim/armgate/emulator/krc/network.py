"""A bad network between KRC and PC: datagrams lost, late, doubled and out of order, by seed."""

import heapq
from collections.abc import Iterator
from dataclasses import dataclass, replace
from random import Random
from typing import Any, Generic, TypeVar

NS = 1_000_000_000
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Disturbance:
    """What happens to the datagrams of one direction; probabilities are of each datagram.

    Attributes:
        loss: It never arrives.
        duplicate: It arrives twice.
        reorder: It waits until the next one has gone ahead.
        delay: All arrive so much later, s.
        jitter: And up to so much later still, s.
        cut: None arrives: the cable is out.
    """

    loss: float = 0.0
    duplicate: float = 0.0
    reorder: float = 0.0
    delay: float = 0.0
    jitter: float = 0.0
    cut: bool = False

    def __post_init__(self) -> None:
        for name in ("loss", "duplicate", "reorder"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise ValueError(f"{name} {getattr(self, name)}; expected a probability, 0 to 1")
        for name in ("delay", "jitter"):
            if not 0.0 <= getattr(self, name) <= 10.0:
                raise ValueError(f"{name} {getattr(self, name)}; expected 0 to 10 s")


class Channel(Generic[T]):
    """One direction, for datagrams of any form. Times are those of the caller's clock, ns.

    Args:
        seed: Of what happens by chance: the same datagrams meet the same fate.
        disturbance: What happens.
    """

    def __init__(self, seed: str, disturbance: Disturbance) -> None:
        self._chance = Random(seed)  # noqa: S311  (a disturbance, not a secret)
        self._waiting: list[tuple[int, int, T]] = []
        self._held: list[T] = []
        self._number = 0
        self._drop = 0
        self.disturbance = disturbance
        self.counts = {"passed": 0, "lost": 0, "doubled": 0, "reordered": 0}
        """What became of the datagrams so far."""

    def drop(self, count: int) -> None:
        """The next ``count`` datagrams are lost."""
        self._drop = count

    def change(self, **changed: Any) -> None:
        """Other disturbances from now on.

        Raises:
            ValueError: A value is out of range.
        """
        self.disturbance = replace(self.disturbance, **changed)

    def put(self, data: T, now: int) -> None:
        """A datagram enters."""
        # All are drawn for each datagram: so one setting does not change another's course.
        lost, doubled, held, late = (self._chance.random() for _ in range(4))
        how = self.disturbance
        if how.cut or self._drop > 0 or lost < how.loss:
            self._drop = max(self._drop - (not how.cut), 0)
            self.counts["lost"] += 1
            return
        if held < how.reorder and not self._held:
            self._held.append(data)
            self.counts["reordered"] += 1
            return
        due = now + round(NS * (how.delay + how.jitter * late))
        twice = doubled < how.duplicate
        self.counts["doubled"] += twice
        released, self._held = self._held, []
        for one in [data, *([data] if twice else []), *released]:
            self._number += 1
            heapq.heappush(self._waiting, (due, self._number, one))

    def get(self, now: int) -> Iterator[tuple[int, T]]:
        """The datagrams that are due, with the time at which they were."""
        while self._waiting and self._waiting[0][0] <= now:
            due, _, data = heapq.heappop(self._waiting)
            self.counts["passed"] += 1
            yield due, data

    @property
    def next_due(self) -> int | None:
        """When the next one is due."""
        return self._waiting[0][0] if self._waiting else None
