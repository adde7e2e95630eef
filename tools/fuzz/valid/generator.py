"""Generator of valid messages: random ones, and plausible ones for the state of the cell."""

from collections.abc import Callable
from random import Random
from typing import Any

from armgate.protocol import messages as m
from armgate.world.states import FIELDS
from tools.fuzz.valid.oracle import Knowledge
from tools.fuzz.valid.values import fields_of

Hint = Callable[[Random, Knowledge], Any]

_WEIGHTS: dict[type[m.Message], int] = {
    m.Command: 40, m.Acquire: 8, m.Release: 3, m.Subscribe: 4, m.Signal: 6, m.Stop: 4, m.Reset: 6, m.Ping: 6,
    m.Asset: 2, m.Describe: 1, m.Pass: 3,
}  # fmt: skip
"""Relative frequency of each type; a type that is not listed has weight 1."""

_HINTED = 0.9
_LEFT_OUT = 0.4


def _robot(rng: Random, known: Knowledge) -> str:
    return rng.choice(known.robots)


def _fence(rng: Random, known: Knowledge) -> int:
    return max(0, known.fences.get(known.chosen, 0) + rng.choice((0, 0, 0, 0, 0, -1, 1)))


def _tick(rng: Random, known: Knowledge) -> int:
    return max(0, known.ticks.get(known.chosen, 0) + rng.choice((0, 0, 0, 0, 0, 0, -1, 1, -4)))


def _dq(rng: Random, known: Knowledge) -> tuple[float, ...]:
    count = known.joints.get(known.chosen, 1)
    roll = rng.random()
    if roll < 0.1:
        return (rng.choice((1e308, -1e308, 1.0, 5e-324)),) * count
    if roll < 0.15:
        return (0.0,) * rng.choice((0, count - 1, count + 1 if count < m.MAX_JOINTS else count))
    size = rng.choice((0.0, 1e-5, 1e-4, 1e-2))
    return tuple(rng.uniform(-size, size) for _ in range(count))


_HINTS: dict[str, Hint] = {
    "robot": lambda rng, known: known.chosen,
    "robots": lambda rng, known: tuple(_robot(rng, known) for _ in range(rng.randint(0, 4))),
    "fields": lambda rng, known: tuple(rng.choices(FIELDS, k=rng.randint(0, 5))),
    "fence": _fence,
    "tick": _tick,
    "dq": _dq,
    "step": lambda rng, known: known.step,
    "stop": lambda rng, known: rng.choice(known.stops_seen) if known.stops_seen else 1,
    "hash": lambda rng, known: rng.choice(known.assets) if known.assets else "0" * 64,
    "offset": lambda rng, known: rng.choice((0, 100)),
    "every": lambda rng, known: rng.choice((1, 1, 2, 7)),
    "speed": lambda rng, known: 1.0,
    "takeover": lambda rng, known: rng.random() < 0.2,
}
"""Plausible values by field; other valid values are sent occasionally."""


class MessageGenerator:
    """Generator of one client's random messages.

    Args:
        rng: Source of all choices.
        known: Knowledge of the client.
    """

    def __init__(self, rng: Random, known: Knowledge) -> None:
        self._rng = rng
        self._known = known
        types = [model for model in m.CLIENT_MESSAGES if model not in (m.Hello, m.Bye)]
        self._types = {model: _WEIGHTS.get(model, 1) for model in types}
        self._id = 0

    def only(self, types: frozenset[type[m.Message]]) -> "MessageGenerator":
        """Generate these types only."""
        self._types = {model: weight for model, weight in self._types.items() if model in types}
        return self

    def next(self) -> m.Message:
        """Return the next message."""
        rng = self._rng
        (model,) = rng.choices(tuple(self._types), tuple(self._types.values()))
        held = tuple(self._known.fences)
        self._known.chosen = rng.choice(held) if held and rng.random() < 0.6 else _robot(rng, self._known)
        return self._made(model)

    def _made(self, model: type[m.Message]) -> m.Message:
        rng, given = self._rng, {}
        for name, make in fields_of(model).items():
            if not model.model_fields[name].is_required() and rng.random() < _LEFT_OUT:
                continue
            hint = _HINTS.get(name)
            given[name] = hint(rng, self._known) if hint and rng.random() < _HINTED else make(rng)
        if "id" in given:
            self._id += 1
            given["id"] = self._id
        return model.model_validate(given)
