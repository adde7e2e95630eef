"""Simulated network between KRC and PC: datagrams are lost, delayed, duplicated and reordered, by seed."""

import heapq
from collections.abc import Iterator
from dataclasses import dataclass, replace
from random import Random
from typing import Any, Generic, TypeVar

NS = 1_000_000_000
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Disturbance:
    """Disturbances of one direction; shares are probabilities for each datagram.

    Attributes:
        loss: Probability that a datagram never arrives.
        duplicate: Probability that a datagram arrives twice.
        reorder: Probability that a datagram waits until the next one has passed it.
        delay: Delay of all datagrams, s.
        jitter: Largest additional delay, s.
        cut: True if the cable is unplugged: no datagram arrives.
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
    """One direction of the network, for datagrams of any type. Times are those of the caller's clock, ns.

    Args:
        seed: Seed of the random numbers: the same datagrams are disturbed in the same way.
        disturbance: Disturbances.
    """

    def __init__(self, seed: str, disturbance: Disturbance) -> None:
        self._chance = Random(seed)  # noqa: S311  (a disturbance, not a secret)
        self._waiting: list[tuple[int, int, T]] = []
        self._held: list[T] = []
        self._number = 0
        self._drop = 0
        self.disturbance = disturbance
        self.counts = {"passed": 0, "lost": 0, "duplicated": 0, "reordered": 0}
        """Numbers of datagrams so far."""

    def drop(self, count: int) -> None:
        """Lose the next ``count`` datagrams."""
        self._drop = count

    def change(self, **changed: Any) -> None:
        """Change disturbances from now on.

        Raises:
            ValueError: A value is out of range.
        """
        self.disturbance = replace(self.disturbance, **changed)

    def put(self, data: T, now: int) -> None:
        """Accept a datagram at the time ``now``."""
        # All random numbers are drawn for each datagram, so that one setting does not affect another one.
        lost, duplicated, held, late = (self._chance.random() for _ in range(4))
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
        twice = duplicated < how.duplicate
        self.counts["duplicated"] += twice
        released, self._held = self._held, []
        for one in [data, *([data] if twice else []), *released]:
            self._number += 1
            heapq.heappush(self._waiting, (due, self._number, one))

    def get(self, now: int) -> Iterator[tuple[int, T]]:
        """Yield the datagrams that are due, each with the time at which it was due."""
        while self._waiting and self._waiting[0][0] <= now:
            due, _, data = heapq.heappop(self._waiting)
            self.counts["passed"] += 1
            yield due, data

    @property
    def next_due(self) -> int | None:
        """Time at which the next datagram is due, None if there is none."""
        return self._waiting[0][0] if self._waiting else None
