"""State machine of the leases: its table, and random event sequences of three sessions and two robots."""

import itertools

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from armgate.protocol import Denial, ErrorCode, Grant, Leases, LeaseState, Loss
from armgate.protocol.lease import TRANSITIONS, LeaseEvent

TTL = 1.0
Held, Free, Stopped = LeaseState.HELD, LeaseState.FREE, LeaseState.STOPPED


@pytest.fixture
def leases():
    return Leases(("FR", "GR"), TTL)


def acquire(leases, robot="FR", session="a", role="controller", *, takeover=False, speed=1.0, now=0.0):
    return leases.acquire(robot, session, role, takeover=takeover, speed=speed, now=now)


def test_a_free_robot_is_granted(leases):
    assert leases.state("FR") is Free
    grant = acquire(leases, speed=0.5, now=3.0)
    assert grant == Grant("FR", "a", 1, 0.5, 4.0, None)
    assert (leases.holder("FR"), leases.holder("GR"), leases.state("FR")) == (grant, None, Held)
    assert leases.held_by("a") == [grant]


@pytest.mark.parametrize(
    ("request_", "code", "text"),
    [
        ({"robot": "XX"}, "unknown_robot", "the cell has FR, GR"),
        ({"role": "observer"}, "forbidden", "connect as a controller"),
        ({"takeover": True}, "forbidden", "only an operator"),
        ({}, "leased", "held by another session"),
        ({"role": "operator"}, "leased", "held by another session"),
        ({"robot": "GR"}, "stopped", "an operator must reset"),
        ({"robot": "GR", "role": "operator", "takeover": True}, "stopped", "an operator must reset"),
    ],
)
def test_requests_that_are_denied_leave_the_holder_unchanged(leases, request_, code, text):
    first = acquire(leases, session="first")
    leases.stop(["GR"], "x")
    denial = acquire(leases, **request_)
    assert isinstance(denial, Denial)
    assert denial.code is ErrorCode(code)
    assert text in denial.text
    assert leases.holder("FR") == first


def test_an_operator_takes_over(leases):
    acquire(leases, session="a")
    grant = acquire(leases, session="b", role="operator", takeover=True)
    assert grant.displaced == Loss("FR", "a", 1, "an operator took the robot over")
    assert (grant.fence, leases.holder("FR").session) == (2, "b")
    assert leases.drop("a") == []


def test_a_repeated_acquire_by_the_holder_gives_a_new_fence_and_speed(leases):
    acquire(leases, speed=0.2)
    grant = acquire(leases, speed=0.9, now=0.5)
    assert (grant.fence, grant.speed, grant.expires, grant.displaced) == (2, 0.9, 1.5, None)
    assert not leases.holds("FR", "a", 1, 0.5)
    assert leases.holds("FR", "a", 2, 0.5)


def test_a_lease_expires_exactly_at_its_time_to_live(leases):
    acquire(leases)
    assert leases.holds("FR", "a", 1, 0.999)
    assert not leases.holds("FR", "a", 1, 1.0)
    assert leases.expire(0.999) == []
    assert leases.expire(1.0) == [Loss("FR", "a", 1, "the holder sent nothing for 1 s")]
    assert leases.expire(1.0) == []
    assert leases.state("FR") is Free


def test_messages_of_the_holder_renew_its_leases(leases):
    acquire(leases, "FR")
    acquire(leases, "GR", now=0.5)
    leases.renew("b", 0.8)
    assert not leases.holds("FR", "a", 1, 1.0)
    leases.renew("a", 0.8)
    assert leases.holds("FR", "a", 1, 1.799)
    assert leases.holds("GR", "a", 1, 1.799)
    leases.renew("a", 1.8)
    assert len(leases.expire(1.8)) == 2, "a message after the expiry renews nothing"
    assert leases.expire(10.0) == []


def test_an_acquire_after_the_expiry_reports_the_displaced_lease(leases):
    acquire(leases)
    grant = acquire(leases, session="b", now=1.0)
    assert (grant.session, grant.fence) == ("b", 2)
    assert grant.displaced == Loss("FR", "a", 1, "the holder sent nothing for 1 s")
    assert leases.expire(1.0) == []


def test_only_the_holder_can_release_with_the_current_fence(leases):
    acquire(leases)
    for robot, session, fence in (("FR", "b", 1), ("FR", "a", 2), ("GR", "a", 1)):
        assert leases.release(robot, session, fence, 0.5).code is ErrorCode.NOT_HELD
    assert leases.release("XX", "a", 1, 0.5).code is ErrorCode.UNKNOWN_ROBOT
    assert leases.release("FR", "a", 1, 1.0).code is ErrorCode.NOT_HELD
    assert leases.release("FR", "a", 1, 0.5).fence == 1
    assert leases.state("FR") is Free


def test_a_stop_ends_leases_until_it_is_lifted(leases):
    acquire(leases)
    assert leases.stop(["FR", "GR"], "stop 1 by c") == [Loss("FR", "a", 1, "stop 1 by c")]
    assert leases.stop(["FR"], "again") == []
    assert acquire(leases).code is ErrorCode.STOPPED
    leases.resume(["FR"])
    assert acquire(leases).fence == 2
    assert leases.state("GR") is Stopped


def test_resume_without_a_stop_changes_nothing(leases):
    acquire(leases)
    leases.resume(["FR", "GR"])
    assert (leases.state("FR"), leases.state("GR")) == (Held, Free)


@pytest.mark.parametrize(("state", "event"), list(itertools.product(LeaseState, LeaseEvent)))
def test_the_table_equals_an_independent_statement(state, event):
    into = {
        Held: {"acquire", "reacquire", "takeover", "renew"},
        Free: {"release", "expire", "drop", "resume"},
        Stopped: {"stop"},
    }
    may = {Free: {"acquire", "stop"}, Stopped: {"stop", "resume"}}
    may[Held] = {event.value for event in LeaseEvent} - {"acquire", "resume"}
    expected = (
        next(s for s, events in into.items() if event.value in events) if event.value in may[state] else None
    )
    assert TRANSITIONS.get((state, event)) is expected


class EventSequences(RuleBasedStateMachine):
    """Invariants in any order of events, checked against a model of holders and expiry times."""

    robots = st.sampled_from(("FR", "GR"))
    sessions = st.sampled_from(("a", "b", "c"))

    def __init__(self):
        super().__init__()
        self.leases = Leases(("FR", "GR"), TTL)
        self.now = 0.0
        self.fences = {"FR": 0, "GR": 0}
        self.held = {}
        self.past = set()
        self.stopped = set()

    def lose(self, losses):
        for loss in losses:
            session, fence, _ = self.held.pop(loss.robot)
            assert (loss.session, loss.fence) == (session, fence), "a loss names a held lease, once"
            self.past.add((loss.robot, session, fence))

    @rule(seconds=st.sampled_from((0.0, 0.1, 0.5, 0.999, 1.0, 5.0)))
    def time_passes(self, seconds):
        self.now += seconds

    @rule(
        robot=robots,
        session=sessions,
        role=st.sampled_from(("observer", "controller", "operator")),
        takeover=st.booleans(),
    )
    def acquire(self, robot, session, role, takeover):
        holder = self.held.get(robot)
        alive = holder is not None and self.now < holder[2]
        answer = acquire(self.leases, robot, session, role, takeover=takeover, now=self.now)
        allowed = role == "operator" or (role == "controller" and not takeover)
        own = alive and holder[0] == session
        given = allowed and robot not in self.stopped and (not alive or own or takeover)
        assert isinstance(answer, Grant if given else Denial)
        if given:
            assert answer.fence > self.fences[robot], "fences only increase"
            assert (answer.displaced is not None) == (holder is not None and not own)
            self.lose([answer.displaced] if answer.displaced else [])
            if own:
                self.past.add((robot, session, holder[1]))
            self.fences[robot] = answer.fence
            self.held[robot] = (session, answer.fence, self.now + TTL)

    @rule(session=sessions)
    def renew(self, session):
        self.leases.renew(session, self.now)
        for robot, (holder, fence, expires) in self.held.items():
            if holder == session and self.now < expires:
                self.held[robot] = (holder, fence, self.now + TTL)

    @precondition(lambda self: self.held)
    @rule(data=st.data(), session=sessions)
    def release(self, data, session):
        robot = data.draw(st.sampled_from(sorted(self.held)))
        holder, fence, expires = self.held[robot]
        answer = self.leases.release(robot, session, fence, self.now)
        assert isinstance(answer, Grant) == (session == holder and self.now < expires)
        if isinstance(answer, Grant):
            self.past.add((robot, *self.held.pop(robot)[:2]))

    @rule()
    def expire(self):
        over = {robot for robot, (_, _, expires) in self.held.items() if self.now >= expires}
        losses = self.leases.expire(self.now)
        assert {loss.robot for loss in losses} == over
        self.lose(losses)

    @rule(session=sessions)
    def drop(self, session):
        own = {robot for robot, (holder, _, _) in self.held.items() if holder == session}
        losses = self.leases.drop(session)
        assert {loss.robot for loss in losses} == own
        self.lose(losses)

    @rule(stopped=st.sets(robots, min_size=1))
    def stop(self, stopped):
        expected = set(self.held) & stopped
        losses = self.leases.stop(sorted(stopped), "stop")
        assert {loss.robot for loss in losses} == expected
        self.lose(losses)
        self.stopped |= stopped

    @rule(robot=robots)
    def resume(self, robot):
        self.leases.resume([robot])
        self.stopped.discard(robot)

    @invariant()
    def former_expired_and_stopped_leases_are_not_held(self):
        for robot, session, fence in self.past:
            assert not self.leases.holds(robot, session, fence, self.now)
        for robot, (session, fence, expires) in self.held.items():
            assert self.leases.holds(robot, session, fence, self.now) == (self.now < expires)
            others = {"a", "b", "c"} - {session}
            assert not any(self.leases.holds(robot, other, fence, self.now) for other in others)

    @invariant()
    def the_states_equal_those_of_the_model(self):
        for robot in ("FR", "GR"):
            held, stopped = robot in self.held, robot in self.stopped
            assert self.leases.state(robot) is (Held if held else Stopped if stopped else Free)
            assert (self.leases.holder(robot) is not None) == held


TestEventSequences = EventSequences.TestCase
TestEventSequences.settings = settings(max_examples=80, stateful_step_count=40, deadline=None)
