"""Delay of a program: its increments take effect later than they were computed."""

from collections import deque
from typing import Any

import numpy as np

from armgate.client.program import REST, Program, SignalValues
from armgate.client.tick import Tick
from armgate.protocol.messages import Verdict


class LateProgram:
    """Program whose increments are sent some ticks after the state that they were computed from.

    The delay of each tick is ``delay`` plus a uniform share of ``jitter``, rounded to ticks. Order is kept:
    an increment never overtakes an earlier one. Until the first increment is due, no command is sent.
    If several are due at once, the newest is sent, as by a client that reads its newest state.

    Args:
        program: The program.
        period: Period of its robot, s.
        delay: Smallest delay, s.
        jitter: Largest additional delay, s.
        seed: Seed of the jitter.
    """

    def __init__(self, program: Program, period: float, delay: float, jitter: float, seed: int) -> None:
        self._program = program
        self._period, self._delay, self._jitter = period, delay, jitter
        self._rng = np.random.default_rng(seed)
        self._waiting: deque[tuple[int, Any, SignalValues]] = deque()
        self._signals: SignalValues = {}
        self._over = False

    @property
    def fields(self) -> Any:
        """Fields of each entry that its ticks contain."""
        return self._program.fields

    @property
    def outcome(self) -> Any:
        """Outcome, once the program has ended."""
        return self._program.outcome

    def step(self, tick: Tick) -> Any:
        """Return the newest increments that are due at this tick."""
        self._compute(tick)
        if self._over and not self._waiting:
            return None
        dq: Any = REST
        self._signals = {}
        while self._waiting and self._waiting[0][0] <= tick.tick:
            _, dq, self._signals = self._waiting.popleft()
        return dq

    def _compute(self, tick: Tick) -> None:
        if self._over:
            return
        dq = self._program.step(tick)
        if dq is None:
            self._over = True
            return
        late = round((self._delay + self._jitter * self._rng.uniform()) / self._period)
        due = max(tick.tick + late, self._waiting[-1][0] if self._waiting else 0)
        self._waiting.append((due, dq, self._program.signals()))

    def signals(self) -> SignalValues:
        """Return the signals that belong to the newest increments."""
        return self._signals

    def verdict(self, verdict: Verdict) -> None:
        """Pass the verdict on."""
        self._program.verdict(verdict)

    def interrupt(self) -> bool:
        """Pass the request on."""
        return self._program.interrupt()
