"""Lock-step without sockets: the order in which clients send makes no difference."""

import io
import itertools
import random

import pytest

from armgate.links.log import Log
from armgate.protocol import RemoteProtocolError, encode
from armgate.protocol import messages as m
from armgate.world.lockstep import Lockstep
from support.cells import arms_config
from support.peers import Bench, Peer


class Stage:
    """A lock-step run with clients in memory, and a wall clock that the test sets."""

    def __init__(self, config, participants=("a", "b"), automatic=True):
        self.wall = 0.0
        self.instants = []
        periods = [robot.period for robot in config.robots.values()]
        log = Log(io.StringIO())
        self.run = Lockstep(periods, participants, 10.0, log, lambda: self.wall, automatic=automatic)
        self.bench = Bench(config, lockstep=True, now=self.run.now)
        self.core = self.bench.core
        self.run.start(self.core, self.due)

    def due(self, time, robots, step):
        self.instants.append((step, robots))
        self.bench.due(time, robots, step)

    @property
    def step(self):
        return self.instants[-1][0]

    def client(self, name, role="controller"):
        peer = Peer(self.run.session_id(name, 77), name, role)
        self.run.join(peer)
        return peer

    def holder(self, name, *robots):
        peer = self.client(name)
        for robot in robots:
            self.run.handle(peer, m.Acquire(robot=robot))
            assert peer.last(m.Lease).state == "held"
        return peer

    def command(self, peer, robot, dq=(0.0005, 0.0, 0.0), seq=None):
        tick = self.bench.gate.view(robot).tick
        seq = self.step if seq is None else seq
        self.run.handle(peer, m.Command(robot=robot, fence=1, seq=seq, tick=tick, dq=dq))


@pytest.fixture(scope="module")
def config(tmp_path_factory):
    return arms_config(tmp_path_factory.mktemp("arms"))


@pytest.fixture
def stage(config):
    return Stage(config)


def test_no_time_passes_before_all_participants_are_done(stage):
    a, b = stage.holder("a", "A"), stage.holder("b", "B")
    stage.command(a, "A")
    assert (stage.step, a.take()) == (0, [])
    stage.command(b, "B")
    assert stage.step == 1
    assert a.last(m.Verdict).outcome == "admitted"
    assert b.last(m.Verdict).outcome == "admitted"


def test_a_participant_that_is_done_is_woken_only_by_the_next_state(stage):
    a, b = stage.holder("a", "A"), stage.holder("b", "B")
    stage.run.handle(a, m.Signal(name="x", value=(1.0,)))
    assert a.batches == 0
    stage.command(a, "A")
    assert (a.batches, b.batches) == (1, 0)
    stage.command(b, "B")
    assert (a.batches, b.batches) == (0, 0)
    stage.command(a, "A")
    stage.run.handle(a, m.Signal(name="y", value=(1.0,)))  # sent in advance: it counts in the next step
    stage.run.handle(a, m.Pass(step=stage.step + 1))
    stage.command(b, "B")
    assert (stage.step, a.batches, b.batches) == (2, 1, 0)


def test_commands_are_decided_in_the_order_of_the_robots(stage):
    a, b = stage.holder("a", "A"), stage.holder("b", "B")
    stage.command(b, "B")
    stage.command(a, "A")
    from armgate.events import Command

    assert [e.robot for e, _ in stage.bench.events if isinstance(e, Command)] == ["A", "B"]


def test_a_participant_that_is_absent_is_waited_for(stage):
    a = stage.client("a")
    stage.run.handle(a, m.Pass(step=0))
    stage.wall = 1e6
    stage.run.drop_silent()
    assert stage.step == 0
    b = stage.client("b")
    stage.run.handle(b, m.Pass(step=0))
    assert stage.step == 1


def test_messages_of_a_participant_that_is_done_count_in_the_next_step(stage):
    a, b = stage.client("a"), stage.client("b")
    stage.run.handle(b, m.Subscribe(robots=("A",)))
    b.take()
    stage.run.handle(a, m.Pass(step=0))
    stage.run.handle(a, m.Signal(name="x", value=(1.0,)))
    assert a.take() == []
    stage.run.handle(b, m.Pass(step=0))
    assert b.last(m.State).signals == {}
    assert isinstance(a.take()[-1], m.Signaled)
    stage.run.handle(a, m.Pass(step=1))
    stage.run.handle(b, m.Pass(step=1))
    assert b.last(m.State).signals["x"].time == 0.012


def test_a_ping_is_answered_while_the_step_waits(stage):
    a = stage.client("a")
    stage.run.handle(a, m.Pass(step=0))
    stage.run.handle(a, m.Ping(time=1.0))
    assert a.last(m.Pong).sent == 0.0


def test_a_pass_message_sent_in_advance_counts_for_its_step(stage):
    a, b = stage.client("a"), stage.client("b")
    for step in range(3):
        stage.run.handle(a, m.Pass(step=step))
    stage.run.handle(b, m.Pass(step=0))
    stage.run.handle(b, m.Pass(step=1))
    assert stage.step == 2
    stage.run.handle(b, m.Pass(step=1))
    assert b.last(m.Error).code == "wrong_step"


def test_too_many_messages_in_advance_end_the_connection(stage):
    a = stage.client("a")
    for step in range(300):
        stage.run.handle(a, m.Pass(step=step))
    assert a.ended
    assert a.take(m.Error)[0].code == "too_many"


def test_a_participant_that_disconnects_when_done_keeps_its_lease_until_the_step_ends(stage):
    a, b = stage.holder("a", "A"), stage.holder("b", "B")
    stage.command(a, "A")
    stage.run.leave(a)
    assert stage.core.leasing.holder("A") == "a"
    stage.command(b, "B")
    assert stage.step == 1
    assert stage.bench.last("A").increment[0] > 0.0
    assert stage.core.leasing.holder("A") is None
    stage.command(b, "B")
    assert stage.step == 2


@pytest.mark.parametrize("order", ["ab", "ba"])
def test_a_participant_that_leaves_receives_no_verdict_however_fast_the_others_are(stage, order):
    a, b = stage.holder("a", "A"), stage.holder("b", "B")
    for name in order:
        if name == "b":
            stage.command(b, "B")
        else:
            stage.command(a, "B")  # a does not hold B, so this does not end its step
            stage.run.leave(a)
    assert stage.step == 1
    assert a.take(m.Verdict) == []


def test_a_participant_that_leaves_ends_the_wait(stage):
    a, b = stage.holder("a", "A"), stage.holder("b", "B")
    stage.command(a, "A")
    stage.run.leave(b)
    assert stage.step == 1
    stage.run.leave(a)
    assert stage.step == 1  # no participant is left: the step waits for the next one
    again = stage.holder("a")
    stage.run.handle(again, m.Pass(step=1))
    assert stage.step == 2


def test_a_silent_participant_is_dropped_and_the_run_has_failed(stage):
    a, b = stage.holder("a", "A"), stage.holder("b", "B")
    stage.run.handle(b, m.Subscribe(robots=("B",)))
    b.take()
    stage.wall = 9.0
    stage.run.handle(a, m.Ping(time=0.0))
    stage.command(b, "B")
    stage.wall = 18.9
    stage.run.drop_silent()
    assert stage.step == 0
    stage.wall = 19.0
    stage.run.drop_silent()
    assert a.ended
    assert a.take(m.Error)[0].code == "silent"
    assert stage.run.failed
    assert stage.step == 1
    stage.command(b, "B")
    assert "participant a sent nothing for 10 s in step 0" in b.take(m.State)[-1].warnings[0]
    stage.run.leave(a)  # its connection closes now
    stage.command(b, "B")
    assert stage.step == 3


def test_a_second_client_with_the_name_of_a_participant_is_refused_without_effect(stage):
    a = stage.holder("a", "A")
    with pytest.raises(RemoteProtocolError, match="connected already") as caught:
        stage.client("a")
    assert caught.value.code.value == "name_taken"
    assert stage.core.leasing.holder("A") == "a"
    assert stage.core.peers[a.client.id] is a


def test_other_clients_observe_and_stop_but_take_no_part(stage):
    eye = stage.client("eye", "operator")
    for message in (m.Acquire(id=1, robot="A"), m.Signal(id=1, name="x", value=(1.0,)), m.Pass(step=0)):
        stage.run.handle(eye, message)
        found = eye.last(m.Error)
        assert (found.code, found.about) == ("not_participant", message.type)
    a = stage.holder("a", "A")
    stage.run.handle(eye, m.Stop(reason="enough"))
    assert eye.last(m.Stopped).by == "eye"
    stage.command(a, "A")
    b = stage.client("b")
    stage.run.handle(b, m.Pass(step=0))
    assert stage.step == 0  # the stop took a's robot: it has to pass now
    stage.run.handle(a, m.Pass(step=0))
    assert stage.step == 1
    assert a.take(m.Verdict)[0].reasons[0].cause in ("lease", "stopped", "fence")
    stage.run.leave(eye)
    assert stage.step == 1


def test_a_stop_by_another_client_ends_the_step_if_the_participants_are_done_by_it(stage):
    a, b, eye = stage.holder("a", "A", "B"), stage.client("b"), stage.client("eye", "operator")
    stage.run.handle(b, m.Pass(step=0))
    stage.command(a, "A")
    assert stage.step == 0  # a holds B, too
    stage.run.handle(eye, m.Stop(robot="B", reason="enough"))
    assert stage.step == 1


def test_with_mixed_periods_a_step_waits_only_for_holders_of_robots_that_ticked(tmp_path):
    stage = Stage(arms_config(tmp_path, periods=(0.012, 0.004)))
    a, b = stage.holder("a", "A"), stage.holder("b", "B")
    stage.command(a, "A")
    for _ in range(7):
        stage.command(b, "B")
    # a's robot ticks at 0 and 12 ms: it is waited for again after b's third step.
    assert stage.step == 3
    assert [robots for _, robots in stage.instants] == [(0, 1), (1,), (1,), (0, 1)]
    stage.command(a, "A")
    assert stage.step == 6


def test_after_a_stop_the_robots_come_to_rest_without_waiting_for_participants(stage):
    a, b = stage.holder("a", "A"), stage.holder("b", "B")
    for _ in range(10):
        stage.command(a, "A", (0.01, 0.0, 0.0))
        stage.command(b, "B")
    stage.command(a, "A", (0.01, 0.0, 0.0))
    stage.core.stop_all("end")
    assert stage.run.let_rest(decide=True)
    while not stage.core.at_rest:
        stage.run.advance()
    assert a.take(m.Verdict)[-1].outcome == "refused"
    step = stage.step
    stage.command(a, "A")
    stage.command(b, "B")
    assert stage.step == step
    assert not stage.run.let_rest(decide=True)


def test_commands_that_wait_are_dropped_if_the_gate_must_not_decide(stage):
    a = stage.holder("a", "A")
    stage.command(a, "A")
    stage.run.let_rest(decide=False)
    stage.run.advance()
    assert a.take(m.Verdict) == []


def test_without_automatic_steps_a_complete_step_ends_only_by_advance(config):
    stage = Stage(config, automatic=False)
    a, b = stage.holder("a", "A"), stage.holder("b", "B")
    stage.command(a, "A")
    assert not stage.run.complete
    stage.command(b, "B")
    assert (stage.step, stage.run.complete) == (0, True)
    stage.run.advance()
    assert (stage.step, stage.run.complete) == (1, False)
    assert a.last(m.Verdict).outcome == "admitted"


# --- two runs agree ---------------------------------------------------------------------------------------


class Script:
    """Messages of a participant, step by step."""

    def __init__(self, name, robot, steps, extra):
        self.name, self.robot, self.steps, self.extra = name, robot, steps, extra
        self.said = 0

    def messages(self, step, tick):
        if step == 0:
            yield m.Subscribe(id=1)
            yield m.Acquire(id=2, robot=self.robot)
        if step in self.extra:
            yield m.Signal(id=3, name=f"{self.name}.x", value=(float(step),))
        dq = (0.0004 * ((step % 5) - 2), 0.0003, -0.0002)
        yield m.Command(robot=self.robot, fence=1, seq=step, tick=tick, dq=dq)
        if step in self.extra:
            yield m.Signal(id=4, name=f"{self.name}.y", value=(float(step),))


def transcript(config, seed):
    """Return the bytes sent to each client if a random client sends the next message each time."""
    choose = random.Random(seed)
    stage = Stage(config)
    scripts = {"a": Script("a", "A", 12, {2, 5}), "b": Script("b", "B", 12, {3, 5})}
    peers = {}
    for name in choose.sample(["a", "b"], 2):
        peers[name] = stage.client(name)
    todo = {
        name: list(itertools.chain(*(s.messages(k, k) for k in range(12)))) for name, s in scripts.items()
    }
    while any(todo.values()):
        name = choose.choice([name for name, left in todo.items() if left])
        stage.run.handle(peers[name], todo[name].pop(0))
    assert stage.step == 12
    return {name: b"".join(encode(message) for message in peer.received) for name, peer in peers.items()}


def test_the_order_of_messages_does_not_change_the_bytes_that_clients_receive(config):
    runs = [transcript(config, seed) for seed in range(6)]
    assert len(runs[0]["a"]) > 10_000
    assert all(run == runs[0] for run in runs)
