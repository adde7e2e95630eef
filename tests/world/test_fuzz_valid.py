"""A short search with valid messages, which must find planted defects (`make fuzz-valid` is the long one)."""

from random import Random

import pytest

from armgate.gate.stops import Stops
from armgate.protocol import messages as m
from armgate.world import to_protocol
from armgate.world.barrier import Barrier
from armgate.world.states import States
from armgate.world.stopping import Stopping
from tools.fuzz.valid.__main__ import main
from tools.fuzz.valid.generator import MessageGenerator
from tools.fuzz.valid.live import Live
from tools.fuzz.valid.oracle import ViolationError
from tools.fuzz.valid.rig import Rig
from tools.fuzz.valid.values import fields_of


def run(folder, *, seed=0, robots=2, joints=3, lockstep=False, messages=1500, only=()):
    rig = Rig(folder, Random(seed), robots, joints, lockstep=lockstep)
    if only:
        rig.types = frozenset(only)
    rig.run(messages)


@pytest.mark.daily(2)
@pytest.mark.parametrize(
    ("robots", "joints", "lockstep", "messages"),
    [(1, 1, False, 1000), (2, 40, False, 1000), (3, 6, True, 1000), (32, 64, False, 150), (32, 1, True, 300)],
)
async def test_valid_messages_never_break_the_daemon(robots, joints, lockstep, messages, tmp_path):
    run(tmp_path, robots=robots, joints=joints, lockstep=lockstep, messages=messages)


@pytest.mark.daily(1)
@pytest.mark.parametrize(("robots", "joints"), [(2, 6), (5, 20)])
async def test_valid_messages_over_sockets_never_break_a_daemon(robots, joints, tmp_path):
    await Live(tmp_path, Random(robots), robots, joints).run(clients=5, messages=120)


async def test_a_daemon_that_does_not_start_is_reported(tmp_path):
    live = Live(tmp_path, Random(1), 1, 1)
    live._file.write_text("armgate: 1\nname: nothing\nrobots: {}\n")
    with pytest.raises(ViolationError, match="did not start"):
        await live.run(clients=1, messages=1)


def test_every_type_of_message_is_sent_with_every_field(tmp_path):
    rig = Rig(tmp_path, Random(1), 1, 2, lockstep=False)
    generator = MessageGenerator(rig.rng, rig.knowledge())
    seen = {}
    for _ in range(6000):
        message = generator.next()
        seen.setdefault(type(message), set()).update(message.model_fields_set - {"type"})
    assert set(seen) == set(m.CLIENT_MESSAGES) - {m.Hello, m.Bye}
    assert all(fields == set(fields_of(model)) for model, fields in seen.items())


def test_the_command_reports_its_messages_and_refuses_wrong_arguments(capsys):
    assert main(["200", "3"]) == 0
    assert "200 valid messages" in capsys.readouterr().out
    assert main(["many"]) == 2


# --- defects that it must find ----------------------------------------------------------------------------


def stops_are_never_replaced(patch):
    patch.setattr(Stops, "_to_replace", lambda self, robots, cause: None)
    patch.setattr(to_protocol, "stops", tuple)


def reasons_without_bound(patch):
    patch.setattr(to_protocol, "reasons", lambda given: tuple(map(to_protocol._reason, given)))


def done_is_reset(patch):
    right = Barrier.done

    def done(self, name):
        self._participants[name].done = False
        return right(self, name)

    patch.setattr(Barrier, "done", done)


def subscribe_answers_twice(patch):
    right = States.subscribe

    def subscribe(self, peer, request):
        right(self, peer, request)
        right(self, peer, request)

    patch.setattr(States, "subscribe", subscribe)


def replaced_stops_unannounced(patch):
    right = Stopping.announce_stop

    def announce_stop(self, given, asker, request):
        return right(self, type(given)(given.id, given.robots, given.reason, given.by), asker, request)

    patch.setattr(Stopping, "announce_stop", announce_stop)


@pytest.mark.parametrize(
    ("plant", "how"),
    [
        (stops_are_never_replaced, {"only": (m.Stop, m.Ping)}),
        (reasons_without_bound, {"joints": 40, "robots": 1, "only": (m.Acquire, m.Command)}),
        (done_is_reset, {"lockstep": True, "robots": 4, "messages": 3000}),
        (subscribe_answers_twice, {}),
        (replaced_stops_unannounced, {}),
    ],
)
async def test_planted_defects_are_found(plant, how, tmp_path, monkeypatch):
    plant(monkeypatch)
    with pytest.raises((ViolationError, ValueError)):
        _search(tmp_path, how)


def _search(folder, how):
    for seed in range(4):
        run(folder, seed=seed, **how)
