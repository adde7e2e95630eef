"""Messages that are built without validation equal validated ones, in everything that a server sends."""

import random
from collections import Counter

import pytest

from armgate.cell.cell import build_cell
from armgate.protocol import encode
from armgate.protocol import messages as m
from armgate.protocol.unvalidated import assembled, unvalidated
from armgate.world import World, signals, states, to_protocol
from support.cells import arms_config
from support.sessions import RandomSessions


@pytest.fixture
def made(monkeypatch):
    """Compare every message that is built without validation with a validated one; count them by model."""
    made = Counter()

    def same(message, expected):
        assert_same(message, expected)
        made[type(message).__name__] += 1
        return message

    def compared(model, **values):
        return same(unvalidated(model, **values), model(**values))

    def compared_whole(model, values, given=None):
        set_ = {name: value for name, value in values.items() if given is None or name in given}
        return same(assembled(model, values, given), model(**set_))

    for module in (to_protocol, states):
        monkeypatch.setattr(module, "unvalidated", compared)
    for module in (to_protocol, states, signals):
        monkeypatch.setattr(module, "assembled", compared_whole)
    return made


def assert_same(message, expected):
    """Check values, their exact types, the order of fields and the fields that are set."""
    assert message == expected
    assert message.model_fields_set == expected.model_fields_set
    assert shape(message) == shape(expected)
    if isinstance(message, m.Message):
        assert encode(message) == encode(expected)


def shape(value):
    """Return the types of a value and of all values in it, in order."""
    match value:
        case m.Message() | m.Part():
            return type(value), [(name, shape(one)) for name, one in value.__dict__.items()]
        case tuple():
            return tuple, [shape(one) for one in value]
        case dict():
            return dict, [(shape(key), shape(one)) for key, one in value.items()]
        case _:
            return type(value)


@pytest.mark.daily(2)
@pytest.mark.parametrize("seed", range(12))
def test_messages_of_random_sessions_equal_validated_ones(tmp_path, made, seed):
    clock = "{kind: lockstep, participants: [a, b], grace: 1000}"
    server = "{port: 0, lease_ttl: 1.0, signals_per_client: 3}"
    cell = build_cell(arms_config(tmp_path, periods=(0.012, 0.004), lag=0.03, clock=clock, server=server))
    RandomSessions(World(cell), random.Random(seed)).run(600)
    assert made.keys() >= {"State", "Entry", "Nearest", "Verdict", "LastVerdict", "SignalValue", "Signaled"}


def test_messages_of_the_demo_cell_equal_validated_ones(made):
    world = World.load("configs/demo.yaml", participants=["a"])
    client = world.join("a")
    client.send(m.Subscribe(fields=("q", "nearest", "verdict", "link")))
    lease = client.request(m.Acquire(robot="FR"))
    rng = random.Random(1)
    for _ in range(60):
        dq = tuple(rng.uniform(-0.05, 0.05) for _ in range(6))
        client.send(m.Command(robot="FR", fence=lease.fence, seq=world.number, tick=world.number, dq=dq))
        world.step()
    assert {one.outcome for one in client.take(m.Verdict)} >= {"limited"}
    assert made["Nearest"] > 100


def test_defaults_are_those_of_the_model_and_do_not_count_as_set():
    message = unvalidated(m.LastVerdict, seq=1, outcome="admitted")
    assert_same(message, m.LastVerdict(seq=1, outcome="admitted"))
    assert message.text == ""
    with pytest.raises(ValueError, match="frozen"):
        message.seq = 2
