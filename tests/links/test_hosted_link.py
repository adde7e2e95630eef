"""One hosted link and successive daemons: ticks, states and plans of each daemon."""

import asyncio

import pytest

from armgate.events import LinkChange, LinkState, Plan, PlanAnswer, PlanKey, Rebase, Tick
from armgate.links.emulated.link import EmulatedLink
from armgate.links.own_clock import OwnClockLink
from armgate.links.robot_server.hosted_link import HostedLink
from armgate.links.robot_server.messages import ResumePoint, TickReport

T = 0.012


class Bench:
    """A hosted link of an emulated robot with two joints, whose clock the test advances."""

    def __init__(self, lag=0.0, settling=0.0):
        self.now = 0.0
        link = EmulatedLink("A", "link", (0.0, 1.0), T, lag)
        self.link = OwnClockLink(link, T, lambda: self.now, self.make_clock)
        self.hosted = HostedLink(self.link, "link", 1e-6, settling)
        self.sent = []
        asyncio.run(self.hosted.open())

    def make_clock(self, period, tick):
        self.turn = tick
        return self

    def start(self):
        pass

    def tick(self, count=1):
        """Let the robot tick; return the messages to the daemon."""
        for _ in range(count):
            self.now += T
            self.turn()
        return self.messages()

    def messages(self):
        sent = list(self.sent)
        self.sent.clear()
        return sent

    def daemon(self, start, tick=0, resets=0):
        self.hosted.detach()
        self.hosted.attach(start, ResumePoint("A", tick, resets), self.sent.append)
        return self.messages()

    def offer(self, start, resets, target, last=-1, increments=((0.1, 0.0), (0.05, 0.0), (0.0, 0.0))):
        self.hosted.offer(Plan("A", PlanKey(start, resets, target, last), 1, increments))
        return self.messages()[-1]


def test_the_first_daemon_finds_the_robot_ready_and_numbers_ticks_from_zero():
    bench = Bench()
    bench.tick(100)
    assert bench.daemon("d1") == [LinkChange("A", LinkState.READY)]
    (first,) = bench.tick()
    assert (first.event.tick, first.event.rebased, first.resets, first.remaining) == (0, False, 0, 0)
    answer = bench.offer("d1", 0, 1)
    assert answer == PlanAnswer("A", PlanKey("d1", 0, 1, -1), True)
    (second,) = bench.tick()
    assert second.event.plan == PlanKey("d1", 0, 1, -1)
    assert (second.event.setpoint, second.event.index, second.remaining) == ((0.1, 1.0), 0, 2)


def test_a_second_daemon_gets_no_tick_before_the_robot_rests_and_cannot_move_it_before_a_rebase():
    bench = Bench(lag=0.03, settling=5 * T)
    bench.daemon("d1")
    bench.tick(8)
    assert bench.offer("d1", 0, 1).reason == "late"
    ticks = [x.event.tick for x in bench.tick()]
    assert bench.offer("d1", 0, ticks[-1] + 1).accepted
    bench.tick()
    (change,) = bench.daemon("d2")
    assert change.state is LinkState.LOST
    assert "reset" in change.reason
    assert bench.tick(3) == []
    assert not bench.link.remaining
    later = []
    while not later:  # the lag, and then the declared window
        later = bench.tick()
    (first,) = later
    assert first.event.tick == 0
    assert first.event.q == pytest.approx((0.15, 1.0), abs=1e-5)
    for start, resets in (("d1", 0), ("d2", 0), ("d1", 1), ("d2", 1)):
        assert bench.offer(start, resets, 1).reason == "inactive"
    (second,) = bench.tick()
    assert second.event.increment == (0.0, 0.0)


def test_a_rebase_arms_the_link_and_earlier_plans_are_refused():
    bench = Bench()
    bench.daemon("d1")
    bench.daemon("d2")
    bench.tick(3)
    bench.hosted.rebase(Rebase("A", (0.0, 1.0), 1))
    assert bench.messages() == [LinkChange("A", LinkState.READY)]
    (played,) = bench.tick()
    assert (played.resets, played.event.setpoint) == (1, (0.0, 1.0))
    target = played.event.tick + 1
    assert bench.offer("d2", 0, target).reason == "mismatch"
    assert bench.offer("d1", 1, target).reason == "mismatch"
    assert bench.offer("d2", 1, target).accepted


def test_after_a_reconnection_ticks_continue_the_numbers_and_the_first_is_rebased():
    bench = Bench()
    bench.daemon("d1")
    bench.tick(5)
    (change,) = bench.daemon("d1", tick=40, resets=2)
    assert change.state is LinkState.LOST
    first, second = (x.event for x in bench.tick(2))
    assert (first.tick, first.rebased) == (40, True)
    assert (second.tick, second.rebased) == (41, False)
    bench.hosted.rebase(Rebase("A", first.q, 3))
    assert bench.offer("d1", 3, 42).accepted


def test_without_a_daemon_the_plan_runs_out():
    bench = Bench()
    bench.daemon("d1")
    bench.tick()
    bench.offer("d1", 0, 1)
    bench.tick()
    bench.hosted.detach()
    assert bench.tick(5) == []
    assert bench.hosted.resting
    bench.daemon("d2")
    assert next(x for x in bench.tick() if isinstance(x, TickReport)).event.setpoint == pytest.approx(
        (0.15, 1.0)
    )


def test_a_disarmed_link_accepts_no_plan():
    bench = Bench()
    bench.daemon("d1")
    bench.tick()
    bench.hosted.disarm()
    (change,) = bench.messages()
    assert (change.state, change.reason) == (LinkState.LOST, "the robot server is ending")
    assert bench.offer("d1", 0, 1).reason == "inactive"


@pytest.mark.parametrize(("off", "reported"), [(1e-3, True), (1.001e-3, False)])
def test_ticks_of_a_resting_robot_under_noise_are_reported_to_the_next_daemon(off, reported):
    """Two measurements of a resting robot differ by up to twice the tolerance."""
    bench = Bench(settling=5 * T)
    bench.hosted = HostedLink(bench.link, "link", 1e-3, 5 * T)
    bench.daemon("d1")
    for k in range(20):
        q = (off * (-1.0) ** k, 1.0)
        bench.hosted._receive(Tick("A", k, T * k, q, (0.0, 1.0), (0.0, 0.0)))
    assert any(isinstance(sent, TickReport) for sent in bench.messages()) == reported
