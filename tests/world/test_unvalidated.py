"""Messages that are built without validation equal validated ones, in everything that a server sends."""

import random
from collections import Counter

import pytest

from armgate.cell.cell import build_cell
from armgate.client.session import Session
from armgate.protocol import encode
from armgate.protocol import messages as m
from armgate.protocol.unvalidated import unvalidated
from armgate.world import World, signals, states, to_protocol
from support.cells import arms_config
from support.sessions import RandomSessions


@pytest.fixture
def made(monkeypatch):
    """Compare every message that is built without validation with a validated one; count them by model."""
    made = Counter()

    def compared(model, values, given=None):
        message = unvalidated(model, values, given)
        assert_same(message, model(**{name: values[name] for name in message.model_fields_set}))
        made[model.__name__] += 1
        return message

    for module in (to_protocol, states, signals):
        monkeypatch.setattr(module, "unvalidated", compared)
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


class Sender:
    """Sender that keeps the messages of a session."""

    def __init__(self):
        self.sent = []

    def send(self, message):
        self.sent.append(message)
        return b""


def test_commands_and_signals_of_a_session_equal_validated_ones():
    sender = Sender()
    session = Session(sender=sender)
    session.take(m.Lease(robot="A", fence=1, state="held", ttl=1.0))
    session.command("A", 1, 5, [0.1, 0.2])
    for value in (1.0, 2.0):  # the first one of a name is validated
        session.signal("a.b", value)
    assert [type(message) for message in sender.sent] == [m.Command, m.Signal, m.Signal]
    for message in sender.sent:
        given = {name: getattr(message, name) for name in message.model_fields_set}
        assert_same(message, type(message)(**given))


def test_fields_count_as_set_as_given_or_all_but_the_type():
    values = {"type": "signaled", "re": None, "name": "a"}
    assert_same(unvalidated(m.Signaled, values, {"name"}), m.Signaled(name="a"))
    message = unvalidated(m.Signaled, values | {"re": 3})
    assert_same(message, m.Signaled(name="a", re=3))
    with pytest.raises(ValueError, match="frozen"):
        message.re = 2
