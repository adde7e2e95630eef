"""A world: clients, steps, and copies that behave alike."""

import random
import subprocess
import sys
from pathlib import Path

import pytest

from armgate.cell.cell import build_cell
from armgate.cell.errors import ConfigError
from armgate.protocol import RemoteProtocolError, encode
from armgate.protocol import messages as m
from armgate.world import SavedWorldError, SessionEndedError, World
from support.cells import arms_config, arms_yaml
from support.sessions import RandomSessions

LOCKSTEP = "{kind: lockstep, participants: [a, b], grace: 1000}"


@pytest.fixture(scope="module")
def cell(tmp_path_factory):
    folder = tmp_path_factory.mktemp("arms")
    return build_cell(arms_config(folder, periods=(0.012, 0.004), lag=0.03, clock=LOCKSTEP))


@pytest.fixture
def world(cell):
    return World(cell)


def holder(world, name, robot):
    client = world.join(name)
    return client, client.request(m.Acquire(robot=robot)).fence


def command(world, robot, fence, seq=1, dq=(1e-5, 0.0, 0.0)):
    tick = round(world.time / world.cell.robot(robot).period)
    return m.Command(robot=robot, fence=fence, seq=seq, tick=tick, dq=dq)


# --- time -------------------------------------------------------------------------------------------------


def test_time_passes_only_in_step(world):
    (a, fence), (b, other) = holder(world, "a", "A"), holder(world, "b", "B")
    a.send(command(world, "A", fence))
    assert not world.complete
    b.send(command(world, "B", other))
    assert (world.complete, world.number, world.time) == (True, 0, 0.0)
    assert a.take() == []
    assert (world.step(), world.time, world.complete) == (1, 0.004, False)
    assert [x.outcome for x in a.take(m.Verdict) + b.take(m.Verdict)] == ["admitted", "admitted"]


def test_a_step_counts_as_the_pass_of_every_participant_that_is_not_done(cell):
    worlds = World(cell), World(cell)
    received = []
    for passes, world in enumerate(worlds):
        (a, fence), b = holder(world, "a", "A"), world.join("b")
        b.send(m.Subscribe())
        for seq in range(8):
            a.send(command(world, "A", fence, seq))
            if passes:
                b.send(m.Pass(step=world.number))
                a.send(*[m.Pass(step=world.number)] * (not world.complete))
                assert world.complete
            world.step()
        received.append([encode(x) for x in a.take() + b.take()])
    assert len(received[0]) > 12
    assert received[0] == received[1]


def test_a_step_waits_for_no_participant_that_has_not_joined(world):
    a = world.join("a")
    a.send(m.Pass(step=0))
    assert not world.complete
    assert world.step() == 1


def test_messages_of_a_participant_that_is_done_count_in_the_next_step(world):
    a = world.join("a")
    a.send(m.Pass(step=0), m.Signal(name="x", value=(1.0,)))
    assert a.take() == []
    world.step()
    assert isinstance(a.take(m.Signaled)[0], m.Signaled)


# --- clients ----------------------------------------------------------------------------------------------


def test_a_request_returns_its_answer_and_leaves_other_messages(world):
    a = world.join("a")
    a.send(m.Subscribe())
    description = a.request(m.Describe())
    assert description.hash == world.cell.hash
    assert [type(x) for x in a.take()] == [m.Subscribed, m.State, m.State]


def test_an_error_that_answers_a_request_is_raised(world):
    a = world.join("a")
    with pytest.raises(RemoteProtocolError, match="no robot Z") as caught:
        a.request(m.Acquire(robot="Z"))
    assert caught.value.code.value == "unknown_robot"


def test_only_requests_that_are_answered_at_once_have_an_answer(world):
    a = world.join("a")
    with pytest.raises(ValueError, match="command is not a request"):
        a.request(command(world, "A", 1))
    a.send(m.Pass(step=0))
    with pytest.raises(ValueError, match="done with this step"):
        a.request(m.Acquire(robot="A"))
    world.step()
    assert a.take(m.Lease)[0].state == "held"


def test_a_name_of_a_participant_is_taken_once(world):
    a = world.join("a")
    with pytest.raises(RemoteProtocolError, match="connected already"):
        world.join("a")
    a.leave()
    assert world.join("a").session == "p0"


def test_a_client_that_leaves_loses_its_robot_and_sends_nothing_more(world):
    a, _ = holder(world, "a", "A")
    eye = world.join("eye", "observer")
    eye.send(m.Subscribe())
    a.leave()
    a.leave()
    assert [type(x) for x in a.take()] == [m.Lease, m.Bye]
    with pytest.raises(SessionEndedError, match="join again"):
        a.send(m.Ping(time=0.0))
    assert world.clients == (eye,)
    eye.take()
    world.step()
    assert {e.holder for state in eye.take(m.State) for e in state.entries} == {None}


def test_a_client_with_too_many_messages_ahead_is_closed_and_loses_its_robot(world):
    a, _ = holder(world, "a", "A")
    with pytest.raises(SessionEndedError):
        a.send(*(m.Pass(step=0) for _ in range(300)))
    assert a.take(m.Error)[0].code == "too_many"
    assert world.clients == ()
    for _ in range(3):  # a session that is done with a step leaves when it is not done with a later one
        world.step()
    b = world.join("b")
    assert b.request(m.Acquire(robot="A")).state == "held"


def test_an_operator_ends_a_session(world):
    a, _ = holder(world, "a", "A")
    op = world.join("op", "operator")
    op.request(m.Kick(session=a.session, reason="test"))
    assert (a.ended, world.clients) == (True, (op,))
    assert a.take(m.Error)[0].code == "kicked"


def test_a_client_is_found_by_its_name(world):
    a = world.join("a")
    assert world.client("a") is a
    with pytest.raises(KeyError, match="no client b; there are a"):
        world.client("b")


# --- configuration ----------------------------------------------------------------------------------------


def test_participants_replace_the_configured_clock(tmp_path):
    file = tmp_path / "arms.yaml"
    file.write_text(arms_yaml())
    with pytest.raises(ValueError, match="no participants"):
        World.load(file)
    with pytest.raises(ValueError, match="twice"):
        World.load(file, participants=["a", "a"])
    world = World.load(file, participants=["a"])
    world.join("a").send(m.Pass(step=0))
    assert world.complete


def test_a_robot_with_a_clock_of_its_own_is_an_error():
    configs = Path(__file__).parents[2] / "configs"
    with pytest.raises(
        ConfigError, match=r"rsi-virtual.yaml:\d+: robots.*link.kind: 'rsi' has a clock of its own"
    ):
        World.load(configs / "demo.yaml", configs / "links" / "rsi-virtual.yaml", participants=["a"])


# --- copies -----------------------------------------------------------------------------------------------


def continued(world, seed):
    """Return the encoded messages of random sessions that continue in a world."""
    sessions = RandomSessions(world, random.Random(seed))
    sessions.open = dict(enumerate(world.clients))
    sessions.received = [[] for _ in sessions.open]
    return sessions.run(250).received


@pytest.mark.daily(3)
@pytest.mark.parametrize("seed", range(12))
def test_a_fork_that_receives_the_same_requests_sends_the_same_bytes(cell, seed):
    world = World(cell, compiled=None if seed % 2 else False)
    RandomSessions(world, random.Random(seed)).run(200)
    forks = [world.fork(), world.fork()]
    expected = continued(world, seed + 1)
    assert sum(map(len, expected)) > 300
    assert continued(forks[0], seed + 1) == expected
    assert continued(forks[1], seed + 1) == expected


def test_forks_do_not_change_each_other(cell):
    world = World(cell)
    a, fence = holder(world, "a", "A")
    fork = world.fork()
    assert fork.cell is world.cell
    b = fork.join("b")
    b.request(m.Acquire(robot="B"))
    fork.client("a").send(command(fork, "A", fence))
    fork.step()
    assert (world.number, world.time) == (0, 0.0)
    assert [client.name for client in world.clients] == ["a"]
    assert [type(x) for x in a.take()] == []


CHILD = """
import pathlib, random, sys
sys.path[:0] = [{tests!r}]
from armgate.cell.cell import build_cell
from armgate.cell.config import load_config
from armgate.world import World
from world.test_world import continued
folder = pathlib.Path({folder!r})
world = World.restored(build_cell(load_config([folder / "arms.yaml"])), (folder / "world").read_bytes())
frames = continued(world, 5)
(folder / "frames").write_bytes(b"".join(b"".join(one) for one in frames))
"""


def test_a_saved_world_continues_in_another_process(tmp_path):
    cell = build_cell(arms_config(tmp_path, periods=(0.012, 0.004), lag=0.03, clock=LOCKSTEP))
    world = World(cell)
    RandomSessions(world, random.Random(4)).run(200)
    (tmp_path / "world").write_bytes(world.save())
    tests = str(Path(__file__).parents[1])
    subprocess.run([sys.executable, "-c", CHILD.format(tests=tests, folder=str(tmp_path))], check=True)
    expected = b"".join(b"".join(one) for one in continued(world, 5))
    assert (tmp_path / "frames").read_bytes() == expected


def test_a_saved_world_is_restored_undamaged_and_for_its_cell_only(cell, tmp_path):
    state = World(cell).save()
    other = build_cell(arms_config(tmp_path, clock=LOCKSTEP))
    with pytest.raises(SavedWorldError, match="its cell is"):
        World.restored(other, state)
    with pytest.raises(SavedWorldError, match="its sha256 is"):
        World.restored(cell, state[:-1])
    with pytest.raises(SavedWorldError, match="not JSON"):
        World.restored(cell, b"\x80\x04.")
    with pytest.raises(SavedWorldError, match="its format is None"):
        World.restored(cell, b"[]\n" + state)


def test_a_saved_world_contains_no_part_of_its_cell(cell):
    assert b"armgate.cell" not in World(cell).save()


@pytest.mark.parametrize("message", [m.Bye(), m.Hello(versions=(1,), name="a", role="controller")])
def test_only_requests_of_clients_are_sent(cell, message):
    client = World(cell).join("a")
    with pytest.raises(ValueError, match=f"{message.type}: not a request of a client.*leave"):
        client.send(message)
