"""Fair scheduling of sessions: their order, and their share of each turn of the event loop.

Ticks are timers of the event loop, so they wait for at most one turn. A turn is bounded by time: each lane
has a slice of it, and work that does not fit waits for the next turn. Privileged sessions are served in their
own lane, before all others: those that hold a robot, and operators by token or user. All others together get
at most half of a core over longer times. Within a lane the identities (tokens, addresses) take turns, so an
identity with many connections gets no more time than one with a single connection.
"""

import asyncio
from collections import deque
from collections.abc import Callable
from time import perf_counter

from armgate.world.token_bucket import TokenBucket

Work = Callable[[], None]

_PRIVILEGED = 1e-3
"""Time in each turn for privileged sessions, s."""

_OTHERS = 250e-6
"""Time in each turn for all other sessions, s."""

SHARE = 0.5
"""Share of a core that serving all other sessions may use over longer times."""

_BURST = 0.02
"""Time that serving all other sessions may use at once beyond that share, s."""

_UNIT = 1e-6
"""Unit of a lane's budget, s."""


class Lane:
    """Work of one priority: one queue for each identity, served in rotation.

    Args:
        slice_: Time that this lane may use in one turn, s.
        clock: A clock for durations, s.
        share: Share of all time that this lane may use; 1: no bound.

    Attributes:
        queued: Number of the newest queued work, counted from 1.
    """

    def __init__(self, slice_: float, clock: Callable[[], float], share: float = 1.0) -> None:
        self._slice = slice_
        self._clock = clock
        self._used = 0.0
        self._budget = None if share >= 1.0 else TokenBucket(share / _UNIT, _BURST / _UNIT, clock())
        self._queues: dict[str, deque[tuple[int, Work]]] = {}
        self.queued = 0

    @property
    def free(self) -> bool:
        """True if nothing waits, and time is left of this turn and of the lane's share."""
        return not self._queues and self._used < self._slice and not self.pause()

    def pause(self) -> float:
        """Return the time until this lane may use its share again, s; 0 if it may now."""
        return 0.0 if self._budget is None else self._budget.wait(self._clock())

    @property
    def waiting(self) -> bool:
        """True if work waits for a turn."""
        return bool(self._queues)

    def add(self, identity: str, work: Work) -> None:
        """Queue work of an identity."""
        self.queued += 1
        self._queues.setdefault(identity, deque()).append((self.queued, work))

    def waits(self, number: int) -> bool:
        """Return True if work up to this number waits."""
        return any(queue[0][0] <= number for queue in self._queues.values())

    def do(self, work: Work) -> None:
        """Do work now and count its time; nested work counts once."""
        begin, used = self._clock(), self._used
        work()
        spent = self._clock() - begin - (self._used - used)
        self._used += spent
        if self._budget is not None:
            self._budget.spend(spent / _UNIT)

    def run(self) -> None:
        """Begin a new turn: do as much work as fits into it, one piece of each identity in rotation."""
        self._used = 0.0
        while self._queues and self._used < self._slice and not self.pause():
            identity, queue = next(iter(self._queues.items()))
            del self._queues[identity]
            _, work = queue.popleft()
            if queue:
                self._queues[identity] = queue
            self.do(work)


class FairScheduler:
    """Scheduler of sessions in two lanes on the running event loop.

    Args:
        clock: A clock for durations, s.
        share: Share of all time that all other sessions may use; 1: no bound.
    """

    def __init__(self, clock: Callable[[], float] = perf_counter, share: float = SHARE) -> None:
        self._privileged = Lane(_PRIVILEGED, clock)
        self._others = Lane(_OTHERS, clock, share)
        self._armed = False
        self._timer: asyncio.TimerHandle | None = None

    def privileged_queued(self) -> int:
        """Return the number of the newest work queued for privileged sessions."""
        return self._privileged.queued

    def privileged_wait(self, number: int) -> bool:
        """Return True if such work up to this number waits."""
        return self._privileged.waits(number)

    def run_now(self, identity: str, privileged: bool, work: Work) -> None:
        """Do work at once if time is left in this turn, else queue it."""
        lane = self._lane(privileged)
        if lane.free:
            lane.do(work)
        else:
            lane.add(identity, work)
        if (
            not lane.free
        ):  # else the used time counts in the next turn, too, which saves a turn of the event loop
            self._arm()

    def run_later(self, identity: str, privileged: bool, work: Work) -> None:
        """Queue work for the next turn."""
        self._lane(privileged).add(identity, work)
        self._arm()

    def _lane(self, privileged: bool) -> Lane:
        return self._privileged if privileged else self._others

    def _arm(self) -> None:
        if not self._armed:
            self._armed = True
            asyncio.get_running_loop().call_soon(self._run)

    def _run(self) -> None:
        self._armed = False
        self._privileged.run()
        self._others.run()
        pause = self._others.pause() if self._others.waiting else 0.0
        if self._privileged.waiting or (self._others.waiting and not pause):
            self._arm()
        elif pause and self._timer is None:
            self._timer = asyncio.get_running_loop().call_later(pause, self._resume)

    def _resume(self) -> None:
        self._timer = None
        self._arm()
