"""Effects of requests and ticks, with a real gate and without sockets."""

import math
import re
from dataclasses import replace
from typing import get_args

import pytest

from armgate import events
from armgate.gate.clearance.engines import CoalEngine
from armgate.protocol import messages as m
from armgate.world import interfaces
from armgate.world.interfaces import ClientRequest
from armgate.world.rights import RIGHTS
from support.cells import arms_config
from support.peers import Bench, Peer


@pytest.fixture(scope="module")
def config(tmp_path_factory):
    return arms_config(tmp_path_factory.mktemp("arms"))


@pytest.fixture
def bench(config):
    return Bench(config).start()


def error(peer, code):
    found = peer.last(m.Error)
    assert (found.code, found.fatal) == (code, False)
    return found


# --- commands ---------------------------------------------------------------------------------------------


def test_an_increment_reaches_the_robot(bench):
    peer, fence = bench.holder("wave", "A")
    (verdict,) = bench.command(peer, "A", fence, 7, (0.001, 0.0, -0.001))
    assert (verdict.seq, verdict.outcome, verdict.tick, verdict.target) == (7, "admitted", 0, 1)
    before = bench.last("A").setpoint
    bench.tick()
    after = bench.last("A")
    assert after.setpoint == pytest.approx([b + d for b, d in zip(before, (0.001, 0.0, -0.001), strict=True)])
    assert after.setpoint == pytest.approx(verdict.setpoint)


def test_the_verdict_comes_before_the_state_that_applies_it(bench):
    peer, fence = bench.holder("wave", "A")
    bench.core.handle(peer, m.Subscribe(robots=("A",)))
    peer.take()
    bench.core.handle(peer, m.Command(robot="A", fence=fence, seq=3, tick=0, dq=(0.001, 0.0, 0.0)))
    bench.tick()
    verdict, state = peer.take()
    assert isinstance(verdict, m.Verdict)
    assert state.entries[0].applied_seq == 3


@pytest.mark.parametrize(
    ("dq", "cause"),
    [
        ((0.001,), "length"),
        ((0.001,) * 4, "length"),
        ((), "length"),
        ((math.nan, 0.0, 0.0), "not_finite"),
        ((0.0, math.inf, 0.0), "not_finite"),
        ((0.0, -math.inf, 0.0), "not_finite"),
    ],
)
def test_every_readable_command_gets_a_verdict_and_a_refused_one_leaves_the_slot_free(bench, dq, cause):
    peer, fence = bench.holder("wave", "A")
    (verdict,) = bench.command(peer, "A", fence, 1, dq)
    assert (verdict.outcome, verdict.reasons[0].cause) == ("refused", cause)
    (verdict,) = bench.command(peer, "A", fence, 2)
    assert verdict.outcome == "admitted"


def test_a_command_for_an_unknown_robot_is_an_error_with_its_seq(bench):
    peer, fence = bench.holder("wave", "A")
    bench.core.handle(peer, m.Command(robot="C", fence=fence, seq=9, tick=0, dq=(0.0,)))
    found = error(peer, "unknown_robot")
    assert (found.seq, found.about) == (9, "command")
    assert "A, B" in found.text


@pytest.mark.parametrize("role", ["observer", "controller", "operator"])
def test_a_client_cannot_command_a_robot_with_a_guessed_fence(bench, role):
    _, fence = bench.holder("wave", "A")
    thief = bench.client("thief", role)
    (verdict,) = bench.command(thief, "A", fence, 1)
    assert verdict.outcome == "refused"
    assert verdict.reasons[0].cause in ("lease", "fence")
    assert not bench.events[-1][0].holder
    bench.tick()
    assert bench.last("A").increment == (0.0, 0.0, 0.0)


def test_a_refused_client_without_the_lease_receives_its_own_fence_and_not_the_holders(bench):
    _, fence = bench.holder("wave", "A")
    stranger = bench.client("stranger")
    for own in (fence, fence + 6):
        (verdict,) = bench.command(stranger, "A", own, 1)
        (reason,) = verdict.reasons
        assert (reason.cause, reason.value, reason.bound) == ("fence", float(own), None)
        assert reason.text == f"fence {own} is not that of a lease of this client: acquire A"


def test_a_former_holders_fence_is_refused(bench):
    peer, old = bench.holder("wave", "A")
    bench.core.handle(peer, m.Acquire(robot="A"))
    fence = peer.last(m.Lease).fence
    assert fence > old
    (verdict,) = bench.command(peer, "A", old, 1)
    assert verdict.reasons[0].cause == "fence"
    (verdict,) = bench.command(peer, "A", fence, 2)
    assert verdict.outcome == "admitted"


def test_without_commands_the_robot_plays_its_plan_to_rest(bench):
    peer, fence = bench.holder("wave", "A")
    for seq in range(8):
        bench.command(peer, "A", fence, seq, (0.001 * (seq + 1), 0.0, 0.0))
        bench.tick()
    assert not bench.core.at_rest
    bench.tick(200)
    assert bench.core.at_rest
    tick = bench.last("A")
    assert tick.plan is None
    assert tick.q == tick.setpoint


# --- leases -----------------------------------------------------------------------------------------------


def test_a_leased_robot_is_denied_with_its_holders_name(bench):
    bench.holder("wave", "A")
    other = bench.client("other")
    bench.core.handle(other, m.Acquire(id=4, robot="A"))
    found = error(other, "leased")
    assert found.re == 4
    assert "wave" in found.text


def test_an_operator_takes_over_and_the_former_holder_is_notified(bench):
    peer, fence = bench.holder("wave", "A")
    operator = bench.client("boss", "operator")
    bench.core.handle(operator, m.Acquire(robot="A", takeover=True, speed=0.5))
    held = operator.last(m.Lease)
    assert (held.state, held.speed) == ("held", 0.5)
    lost = peer.last(m.Lease)
    assert (lost.state, lost.fence) == ("lost", fence)
    assert held.fence > fence
    assert events.LeaseChange("A", held.fence, 0.5) in [event for event, _ in bench.events]
    (verdict,) = bench.command(peer, "A", fence, 1)
    assert verdict.outcome == "refused"


def test_a_controller_may_not_take_over(bench):
    bench.holder("wave", "A")
    other = bench.client("other")
    bench.core.handle(other, m.Acquire(robot="A", takeover=True))
    error(other, "forbidden")


def test_any_message_renews_a_lease_and_it_expires_without_messages(bench):
    peer, fence = bench.holder("wave", "A")
    bench.time.now += 0.9
    bench.core.handle(peer, m.Ping(time=0.0))
    peer.take()
    bench.time.now += 0.9
    bench.tick()
    assert peer.take() == []
    bench.time.now += 0.2
    bench.tick()
    lost = peer.last(m.Lease)
    assert (lost.state, lost.fence, lost.re) == ("lost", fence, None)
    assert events.LeaseChange("A", None) in [event for event, _ in bench.events]
    assert bench.core.leasing.holder("A") is None


def test_a_command_after_the_time_to_live_is_refused_even_before_the_next_tick(bench):
    peer, fence = bench.holder("wave", "A")
    bench.time.now += 1.5
    lease, verdict = bench.command(peer, "A", fence, 1)
    assert lease.state == "lost"
    assert verdict.outcome == "refused"


def test_a_released_robot_is_free(bench):
    peer, fence = bench.holder("wave", "A")
    bench.core.handle(peer, m.Release(id=2, robot="A", fence=fence))
    lease = peer.last(m.Lease)
    assert (lease.state, lease.re) == ("released", 2)
    bench.holder("other", "A")
    bench.core.handle(peer, m.Release(robot="A", fence=fence))
    error(peer, "not_held")


def test_a_session_that_ends_frees_its_robots_and_signals(bench):
    peer, _ = bench.holder("wave", "A")
    bench.core.handle(peer, m.Signal(name="x", value=(1.0,)))
    bench.core.leave(peer)
    bench.core.leave(peer)
    other, _ = bench.holder("other", "A")
    bench.core.handle(other, m.Signal(name="x", value=(2.0,)))
    assert isinstance(other.take()[-1], m.Signaled)


# --- stop and reset ---------------------------------------------------------------------------------------


def test_a_stop_by_an_observer_stops_all_robots_and_notifies_all_clients(bench):
    peer, fence = bench.holder("wave", "A")
    watcher = bench.client("eye", "observer")
    bench.core.handle(watcher, m.Stop(id=3, reason="smoke"))
    stopped = watcher.last(m.Stopped)
    assert (stopped.re, stopped.robots, stopped.reason, stopped.by) == (3, ("A", "B"), "smoke", "eye")
    told, lost = peer.take()
    assert (told.re, told.stop) == (None, stopped.stop)
    assert lost.state == "lost"
    (verdict,) = bench.command(peer, "A", fence, 1)
    assert verdict.outcome == "refused"
    bench.core.handle(peer, m.Acquire(robot="A"))
    error(peer, "stopped")


def test_one_robot_is_stopped_alone(bench):
    peer, fence = bench.holder("wave", "B")
    bench.core.handle(peer, m.Stop(robot="A"))
    assert peer.last(m.Stopped).robots == ("A",)
    (verdict,) = bench.command(peer, "B", fence, 1)
    assert verdict.outcome == "admitted"
    bench.core.handle(peer, m.Stop(id=8, robot="C"))
    assert error(peer, "unknown_robot").re == 8


def test_a_reset_needs_an_operator_a_known_stop_and_robots_at_rest(bench):
    peer, fence = bench.holder("wave", "A")
    for seq in range(8):
        bench.command(peer, "A", fence, seq, (0.002 * (seq + 1), 0.0, 0.0))
        bench.tick()
    bench.core.handle(peer, m.Stop())
    stop = peer.last(m.Stopped).stop
    peer.take()
    bench.core.handle(peer, m.Reset(stop=stop))
    error(peer, "forbidden")
    boss = bench.client("boss", "operator")
    bench.core.handle(boss, m.Reset(id=1, stop=stop))
    assert error(boss, "moving").re == 1
    bench.core.handle(boss, m.Reset(stop=stop + 5))
    error(boss, "unknown_stop")
    bench.tick(200)
    bench.core.handle(boss, m.Reset(id=2, stop=stop))
    resumed = boss.last(m.Resumed)
    assert (resumed.re, resumed.stop, resumed.by) == (2, stop, "boss")
    assert peer.last(m.Resumed).re is None
    peer.take()
    bench.tick()
    bench.core.handle(peer, m.Acquire(robot="A"))
    fence = peer.last(m.Lease).fence
    (verdict,) = bench.command(peer, "A", fence, 100)
    assert verdict.outcome == "admitted"
    bench.tick()
    assert bench.last("A").setpoint == pytest.approx(verdict.setpoint)


def test_a_robot_under_two_stops_is_free_after_the_second_reset(bench):
    boss = bench.client("boss", "operator")
    bench.core.handle(boss, m.Stop())
    bench.core.handle(boss, m.Stop(robot="A"))
    first, second = (stopped.stop for stopped in boss.take(m.Stopped))
    bench.core.handle(boss, m.Reset(stop=first))
    boss.take()
    bench.core.handle(boss, m.Acquire(robot="A"))
    error(boss, "stopped")
    bench.core.handle(boss, m.Acquire(robot="B"))
    assert boss.last(m.Lease).state == "held"
    bench.core.handle(boss, m.Reset(stop=second))
    boss.take()
    bench.core.handle(boss, m.Acquire(robot="A"))
    assert boss.last(m.Lease).state == "held"


def test_a_client_that_supports_replaced_stops_resets_only_the_stop_that_it_names(bench):
    boss, eye = bench.client("boss", "operator"), bench.client("eye", "observer")
    boss.change(capabilities=frozenset({"stop.replaces"}))
    for _ in range(2):
        bench.core.handle(eye, m.Stop(robot="A"))
    bench.tick()
    first, second = [stopped.stop for stopped in eye.take(m.Stopped)]
    bench.core.handle(boss, m.Reset(stop=first))
    error(boss, "unknown_stop")
    assert eye.take(m.Resumed) == []
    bench.core.handle(boss, m.Reset(stop=second))
    assert boss.last(m.Resumed).stop == second


def test_many_stops_of_one_client_are_one_stop(bench):
    boss, eye = bench.client("boss", "operator"), bench.client("eye", "observer")
    for _ in range(200):
        bench.core.handle(eye, m.Stop(robot="A"))
    bench.tick()
    told = [stopped.stop for stopped in eye.take(m.Stopped)]
    assert told == sorted(set(told))
    bench.core.handle(boss, m.Subscribe())
    entry = boss.take(m.State)[0].entries[0]
    assert entry.stops == (told[-1],)
    bench.core.handle(boss, m.Reset(id=1, stop=told[3]))
    resumed = boss.last(m.Resumed)
    assert (resumed.re, resumed.stop, resumed.lifted) == (1, told[3], told[-1])
    assert (heard := eye.last(m.Resumed)).stop == told[-1]
    assert heard.lifted is None
    bench.core.handle(boss, m.Acquire(robot="A"))
    assert boss.last(m.Lease).state == "held"


@pytest.mark.slow
def test_clients_of_many_names_cannot_raise_more_stops_than_a_state_may_hold(bench):
    eye = bench.client("eye", "observer")
    for number in range(300):
        peer = bench.client(f"c{number}")
        bench.core.handle(peer, m.Stop(robot="A", reason=f"{number}"))
        bench.core.handle(peer, m.Stop(reason=f"{number}"))
    bench.tick()
    bench.core.handle(eye, m.Subscribe())
    stops = eye.take(m.State)[0].entries[0].stops
    assert 2 < len(stops) <= m.MAX_STOPS
    boss = bench.client("boss", "operator")
    for stop in stops:
        bench.core.handle(boss, m.Reset(stop=stop))
    assert len(boss.take(m.Resumed)) == len(stops)
    bench.core.handle(boss, m.Acquire(robot="A"))
    assert boss.last(m.Lease).state == "held"


def test_no_stop_is_reset_while_the_daemon_ends(bench):
    boss = bench.client("boss", "operator")
    bench.core.end("the daemon is ending")
    stopped = boss.last(m.Stopped)
    assert stopped.by == "daemon"
    bench.core.handle(boss, m.Reset(stop=stopped.stop))
    error(boss, "shutting_down")


# --- states -----------------------------------------------------------------------------------------------


def test_a_subscriber_gets_the_latest_state_of_each_robot_at_once(bench):
    eye = bench.client("eye", "observer")
    bench.core.handle(eye, m.Subscribe(id=1))
    subscribed, a, b = eye.take()
    assert (subscribed.re, subscribed.robots) == (1, ("A", "B"))
    assert "q" in subscribed.fields
    assert [(s.robot, s.tick) for s in (a, b)] == [("A", 0), ("B", 0)]
    assert [entry.robot for entry in a.entries] == ["A", "B"]
    bench.tick()
    assert [(s.robot, s.tick) for s in eye.take()] == [("A", 1), ("B", 1)]


def test_all_robots_of_an_instant_tick_before_its_states_are_sent(bench):
    eye = bench.client("eye", "observer")
    bench.core.handle(eye, m.Subscribe())
    eye.take()
    bench.tick()
    first, second = eye.take()
    assert first.entries == second.entries
    assert {entry.tick for entry in first.entries} == {1}


def test_every_n_th_tick_of_some_robots_with_some_fields(bench):
    eye = bench.client("eye", "observer")
    bench.core.handle(eye, m.Subscribe(every=3, robots=("B",), fields=("setpoint", "q")))
    subscribed, state = eye.take()
    assert subscribed.fields == ("q", "setpoint")
    bench.tick(7)
    states = [state, *eye.take()]
    assert [(s.robot, s.tick) for s in states] == [("B", 0), ("B", 3), ("B", 6)]
    entry = states[-1].entries[0]
    assert entry.model_fields_set == {"robot", "tick", "time", "q", "setpoint"}
    bench.core.handle(eye, m.Subscribe(every=0))
    eye.take()
    bench.tick(3)
    assert eye.take() == []


@pytest.mark.parametrize(
    ("wish", "code"), [({"robots": ("C",)}, "unknown_robot"), ({"fields": ("qq",)}, "unknown_field")]
)
def test_a_subscription_to_an_unknown_robot_or_field_is_an_error(bench, wish, code):
    eye = bench.client("eye", "observer")
    bench.core.handle(eye, m.Subscribe(id=5, **wish))
    assert error(eye, code).re == 5


def test_a_state_is_encoded_once_for_all_clients_with_the_same_fields(bench, monkeypatch):
    encoded, real = [], interfaces.encode
    monkeypatch.setattr(interfaces, "encode", lambda state: encoded.append(state) or real(state))
    monkeypatch.setattr(Peer, "send_states", lambda self, *states: [state.frame for state in states])
    for number in range(20):
        peer = bench.client(f"eye{number}", "observer")
        bench.core.handle(peer, m.Subscribe(fields=("q",) if number % 2 else None))
    encoded.clear()
    bench.tick()
    assert len(encoded) == 4  # two robots, two sets of fields


def test_the_state_holds_holder_stops_verdict_and_signals(bench):
    peer, fence = bench.holder("wave", "A")
    bench.core.handle(peer, m.Signal(id=6, name="lead.progress", value=(0.25,)))
    assert peer.last(m.Signaled).re == 6
    bench.command(peer, "A", fence, 5, (math.nan, 0.0, 0.0))
    eye = bench.client("eye", "observer")
    bench.core.warn("late", "2 ticks came late")
    bench.tick()
    bench.core.handle(eye, m.Subscribe(robots=("A",)))
    state = eye.last(m.State)
    a, b = state.entries
    assert (a.holder, b.holder, a.link, a.stops) == ("wave", None, "ready", ())
    assert (a.verdict.seq, a.verdict.outcome, a.verdict.cause) == (5, "refused", "not_finite")
    assert a.counts == {"refused:not_finite": 1}
    assert state.signals["lead.progress"].value == (0.25,)
    assert state.signals["lead.progress"].owner == "wave"
    assert state.warnings == ("2 ticks came late",)
    assert a.nearest


def test_a_wrong_distance_engine_is_reported_in_the_state(config, monkeypatch):
    """The engine overstates every distance: the state has a warning, and the proven bounds are unaffected."""
    honest = CoalEngine.query

    def overstated(self, *asked):
        distance, *rest = honest(self, *asked)
        return distance + 1.0, *rest

    monkeypatch.setattr(CoalEngine, "query", overstated)
    bench = Bench(config).start()
    eye = bench.client("eye", "observer")
    bench.tick()
    bench.core.handle(eye, m.Subscribe(robots=("A",)))
    (warning,) = eye.last(m.State).warnings
    expected = r"distance engine: (\d+) of \1 distances differ from the proven bound by more than 0\.1 mm"
    assert re.fullmatch(expected, warning)


# --- the rest ---------------------------------------------------------------------------------------------


def test_every_request_has_roles_and_operators_may_send_all():
    requests = set(m.CLIENT_MESSAGES) - {m.Hello, m.Bye}
    assert set(RIGHTS) == set(get_args(ClientRequest)) == requests
    assert all("operator" in roles for roles in RIGHTS.values())


@pytest.mark.parametrize(
    ("role", "message"),
    [
        ("observer", m.Acquire(id=1, robot="A")),
        ("observer", m.Signal(id=1, name="x", value=(1.0,))),
        ("controller", m.Reset(id=1, stop=1)),
    ],
)
def test_a_request_without_the_right_is_forbidden(bench, role, message):
    peer = bench.client("p", role)
    bench.core.handle(peer, message)
    found = error(peer, "forbidden")
    assert (found.re, found.about) == (1, message.type)


def test_a_pass_message_outside_lock_step_is_an_error(bench):
    peer = bench.client("p")
    bench.core.handle(peer, m.Pass(step=0))
    error(peer, "no_lockstep")


def test_a_ping_is_answered_with_the_daemons_time(bench):
    peer = bench.client("p")
    bench.time.now = 2.5
    bench.core.handle(peer, m.Ping(id=7, time=99.0))
    pong = peer.last(m.Pong)
    assert (pong.re, pong.time, pong.received, pong.sent) == (7, 99.0, 2.5, 2.5)


def test_the_described_urdf_is_sent_in_pieces_and_unknown_assets_are_refused(bench):
    peer = bench.client("p")
    bench.core.handle(peer, m.Describe(id=1))
    description = peer.last(m.Description)
    assert description.re == 1
    assert description.hash == bench.cell.hash
    robot = description.robots[0]
    pieces = b""
    while len(pieces) < robot.urdf.size:
        bench.core.handle(peer, m.Asset(hash=robot.urdf.hash, offset=len(pieces), length=700))
        pieces += peer.last(m.Chunk).data
    assert pieces.decode() == bench.cell.robots[0].urdf
    bench.core.handle(peer, m.Asset(hash=robot.urdf.hash, offset=len(pieces) + 1))
    error(peer, "unknown_asset")
    bench.core.handle(peer, m.Asset(hash="0" * 64))
    error(peer, "unknown_asset")


def test_bodies_are_described_in_their_links_frame(bench):
    from armgate.cell.placement import Placement

    peer = bench.client("p")
    bench.core.handle(peer, m.Describe())
    description = peer.last(m.Description)
    robot = bench.cell.robots[1]
    q = [0.3, -0.4, 0.5]
    R, t = robot.model.body_placements(q)
    bodies = [body for body in description.bodies if body.robot == "B"]
    assert len(bodies) == len(robot.model.bodies)
    for index, body in enumerate(bodies):
        placed = robot.model.frame(q, body.link) @ Placement.from_quaternion(body.xyz, body.xyzw)
        assert placed.t == pytest.approx(t[index], abs=1e-9)
        assert pytest.approx(R[index], abs=1e-9) == placed.R
    assert [body.name for body in description.bodies if body.robot is None] == ["post"]


# --- order of sending states ------------------------------------------------------------------------------


class Turns:
    """Scheduler that runs the waiting clients only when the test calls `next`."""

    def __init__(self):
        self.waiting = []

    def __call__(self, peer, function):
        self.waiting.append((peer, function))

    def next(self, count=100):
        given, self.waiting = self.waiting[:count], self.waiting[count:]
        for _, function in given:
            function()


@pytest.fixture
def crowd(config):
    """A bench with turns, a holder, and twenty observers."""
    turns = Turns()
    bench = Bench(config, defer=turns).start()
    eyes = [bench.client(f"eye{number}", "observer") for number in range(20)]
    holder, _ = bench.holder("wave", "A")
    for peer in (*eyes, holder):
        bench.core.handle(peer, m.Subscribe())
        peer.take()
    return bench, turns, holder, eyes


def shown(peers):
    """Return the number of clients that were sent states: of one instant, one per robot, in order."""
    count = 0
    for peer in peers:
        states = peer.take(m.State)
        assert [state.robot for state in states] in ([], ["A", "B"])
        count += bool(states)
    return count


def test_holders_are_sent_states_at_once_and_observers_in_their_turn(crowd):
    bench, turns, holder, eyes = crowd
    bench.tick()
    assert (shown([holder]), shown(eyes)) == (1, 0)
    assert [peer for peer, _ in turns.waiting] == eyes
    turns.next(8)
    assert shown(eyes) == 8
    turns.next()
    assert shown(eyes) == 12
    assert turns.waiting == []


def test_observers_whose_turn_does_not_come_are_sent_only_the_latest_state(crowd):
    bench, turns, holder, eyes = crowd
    bench.core.handle(eyes[0], m.Subscribe(robots=("B",), every=2))
    eyes[0].take()
    bench.tick(3)
    assert len(turns.waiting) == len(eyes)
    turns.next()
    assert [(state.robot, state.tick) for state in eyes[0].take(m.State)] == [("B", 2)]
    for eye in eyes[1:]:
        assert [(state.robot, state.tick) for state in eye.take(m.State)] == [("A", 3), ("B", 3)]
    assert [state.tick for state in holder.take(m.State) if state.robot == "A"] == [1, 2, 3]


def test_an_observer_that_becomes_a_holder_is_sent_its_waiting_states_first(crowd):
    bench, turns, _, eyes = crowd
    bench.core.handle(eyes[0], m.Subscribe(robots=("B",), every=2))
    bench.tick(2)
    eyes[0].take()
    eyes[0].change(role="controller")
    bench.core.handle(eyes[0], m.Acquire(robot="B"))
    bench.tick(2)
    assert [state.tick for state in eyes[0].take(m.State)] == [4]
    turns.next()
    assert eyes[0].take(m.State) == []


def test_a_new_subscription_sends_no_state_twice_and_an_ended_session_gets_none(crowd):
    bench, turns, _, eyes = crowd
    bench.tick()
    bench.core.handle(eyes[-1], m.Subscribe())
    bench.core.handle(eyes[-2], m.Subscribe(every=0))
    bench.core.leave(eyes[-3])
    turns.next()
    assert shown(eyes[-1:]) == 1
    assert shown(eyes[-3:-1]) == 0


# --- tokens -----------------------------------------------------------------------------------------------


def test_a_robot_that_the_token_does_not_name_cannot_be_acquired(bench):
    peer = bench.client("lab")
    peer.change(robots=frozenset({"A"}))
    bench.core.handle(peer, m.Acquire(robot="B", id=3))
    refused = error(peer, "forbidden")
    assert (refused.re, refused.about) == (3, "acquire")
    bench.core.handle(peer, m.Acquire(robot="A"))
    assert peer.last(m.Lease).state == "held"
    boss = bench.client("boss", "operator")
    boss.change(robots=frozenset({"B"}))
    bench.core.handle(boss, m.Acquire(robot="A", takeover=True))
    error(boss, "forbidden")


def test_a_robot_that_has_just_played_its_last_increment_is_not_yet_at_rest(bench):
    peer, fence = bench.holder("wave", "A")
    bench.tick(3)
    assert bench.core.at_rest
    bench.command(peer, "A", fence, 1, (0.0001, 0.0, 0.0))
    while not bench.core.at_rest:
        bench.tick()
    last = bench.last("A")
    assert last.q == pytest.approx(last.setpoint, abs=1e-6)
    assert last.increment == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(("off", "rests"), [(0.99e-6, True), (1.01e-6, False)])
def test_noise_within_the_tolerance_does_not_count_as_motion(bench, off, rests):
    bench.tick(3)
    tick = bench.last("A")
    for k in range(4):
        bench.core.note([replace(tick, q=tuple(x + off * (-1.0) ** k for x in tick.q))])
    assert bench.core.at_rest == rests
