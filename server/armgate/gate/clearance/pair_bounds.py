"""Kept lower bounds of all pairs, robot by robot: proven for the occupancies that are held.

A pair of two robots has an entry in the rows of both, and the two always agree. So a decision reads and
writes the bounds of one robot in one piece.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.intp]


class PairBounds:
    """One lower bound per pair, m; −∞ at first.

    Args:
        pairs_of: The pairs of each robot, by index; a bound has the same place as its pair.
    """

    def __init__(self, pairs_of: Sequence[Index]) -> None:
        ends = np.cumsum([0, *map(len, pairs_of)]).tolist()
        self._ends = ends
        self._all = np.full(ends[-1], -np.inf)
        self._of = self._rows()
        self._places: dict[int, list[tuple[int, int]]] = {}
        for robot, ids in enumerate(pairs_of):
            for k, pair in enumerate(ids.tolist()):
                self._places.setdefault(pair, []).append((robot, k))
        self._shared: list[list[tuple[int, Index, Index]]] = [[] for _ in pairs_of]
        for i, mine in enumerate(pairs_of):
            for k, theirs in enumerate(pairs_of):
                _, here, there = np.intersect1d(mine, theirs, assume_unique=True, return_indices=True)
                if i != k and len(here):
                    self._shared[i].append((k, here, there))
        # All copies of a robot's pairs in the rows of others: source in its own row, target among all bounds.
        self._copies = [
            (_joined([here for _, here, _ in shared]), _joined([ends[k] + there for k, _, there in shared]))
            for shared in self._shared
        ]

    def _rows(self) -> list[Array]:
        """Return the bounds of each robot, as views of all bounds."""
        return [self._all[slice(*reach)] for reach in pairwise(self._ends)]

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore a copy: a pickled view would no longer share its memory."""
        self.__dict__.update(state)
        self._of = self._rows()

    def of(self, robot: int) -> Array:
        """Return the bounds of a robot's pairs, (P,), for reading only."""
        return self._of[robot]

    def shared(self, robot: int) -> list[tuple[int, Index, Index]]:
        """Return each robot that shares pairs with this one, and the places of these pairs in both rows."""
        return self._shared[robot]

    def __getitem__(self, pair: int) -> float:
        robot, k = self._places[pair][0]
        return float(self._of[robot][k])

    def __setitem__(self, pair: int, lb: float) -> None:
        for robot, k in self._places[pair]:
            self._of[robot][k] = lb

    def put(self, robot: int, lb: Array) -> None:
        """Replace the bounds of a robot's pairs, (P,)."""
        here, there = self._copies[robot]
        self._of[robot][:] = lb
        self._all[there] = lb[here]

    def lower(self, robot: int, lb: Array) -> None:
        """Keep the lower of both bounds of a robot's pairs, (P,)."""
        self.put(robot, np.minimum(self._of[robot], lb))


def _joined(parts: list[Index]) -> Index:
    return np.concatenate(parts) if parts else np.zeros(0, np.intp)
