"""Turns of the event loop and rate limits: bounded in time, fair between identities, holders first."""

import asyncio
from time import perf_counter, sleep

import pytest

from armgate.daemon.sessions.rate_limits import RateLimit, RateLimits, Rates
from armgate.daemon.sessions.scheduler import FairScheduler, Lane
from armgate.world.token_bucket import TokenBucket


class Clock:
    """A clock that advances only with work."""

    def __init__(self):
        self.now = 0.0

    def __call__(self):
        return self.now


class Works:
    """Pieces of work that take time and note their identity."""

    def __init__(self):
        self.clock, self.done = Clock(), []

    def of(self, name, seconds=1e-4):
        def work():
            self.clock.now += seconds
            self.done.append(name)

        return work


# --- lanes and turns --------------------------------------------------------------------------------------


def test_a_lane_does_no_more_in_a_turn_than_its_slice():
    works = Works()
    lane = Lane(1e-3, works.clock)
    for _ in range(100):
        lane.add("a", works.of("a"))
    lane.run()
    assert len(works.done) in (10, 11)
    lane.run()
    assert len(works.done) in (20, 22)
    assert lane.waiting


def test_the_time_of_nested_work_counts_once():
    works = Works()
    lane = Lane(1e-3, works.clock, share=0.5)

    def outer():
        works.of("outer")()
        lane.do(works.of("inner", 3e-4))

    lane.do(outer)
    assert lane._used == pytest.approx(4e-4)


def test_a_queue_number_waits_until_all_work_up_to_it_is_done():
    works = Works()
    lane = Lane(1.5e-4, works.clock)
    for name in "aab":
        lane.add(name, works.of(name))
    queued = lane.queued
    lane.add("b", works.of("later"))
    lane.run()
    assert works.done == ["a", "b"]
    assert lane.waits(queued)
    lane.run()
    assert lane.queued == queued + 1
    assert not lane.waits(queued)


def test_identities_take_turns_however_much_each_has_queued():
    works = Works()
    lane = Lane(1.0, works.clock)
    for name in "aaaaaabbc":
        lane.add(name, works.of(name))
    lane.run()
    assert "".join(works.done) == "abcabaaaa"
    assert not lane.waiting


def test_an_identity_with_sixty_connections_delays_another_by_one_piece_of_work():
    works = Works()
    lane = Lane(1e-3, works.clock)
    for _ in range(60):
        lane.add("crowd", works.of("crowd"))
    lane.run()
    before = len(works.done)
    lane.add("alone", works.of("alone"))
    lane.run()
    assert "alone" in works.done[before : before + 2]


async def test_work_is_done_at_once_while_the_turn_has_time_and_queued_after_that():
    works = Works()
    turns = FairScheduler(works.clock)
    for _ in range(20):
        turns.run_now("a", False, works.of("a"))
    at_once = len(works.done)
    assert at_once == 3  # 0.25 ms
    turns.run_now("h", True, works.of("h"))
    assert works.done[-1] == "h"
    await asyncio.sleep(0)
    assert len(works.done) == 2 * at_once + 1


async def test_holders_are_served_before_others_and_both_in_every_turn():
    works = Works()
    turns = FairScheduler(works.clock)
    for _ in range(100):
        turns.run_later("h", True, works.of("h"))
        turns.run_later("a", False, works.of("a"))
    await asyncio.sleep(0)
    first = "".join(works.done)
    assert first == "h" * 10 + "a" * 3
    for _ in range(50):
        await asyncio.sleep(0)
    assert len(works.done) == 200


async def test_sessions_without_a_robot_get_their_share_of_a_core_and_holders_the_rest():
    works = Works()
    turns = FairScheduler(works.clock, share=0.5)
    for _ in range(2000):
        turns.run_later("a", False, works.of("a"))
    while works.clock.now < 0.1:
        works.clock.now += 5e-5  # what the event loop does besides
        turns.run_later("h", True, works.of("h", 5e-5))
        await asyncio.sleep(0)
    assert 0.9 * (0.02 + 0.05) <= 1e-4 * works.done.count("a") <= 1.05 * (0.02 + 0.05)
    assert works.done.count("h") >= 0.9 * 0.1 / 3e-4


async def test_work_that_waits_for_its_share_is_done_later_without_new_work():
    turns, done = FairScheduler(share=0.5), asyncio.Event()
    begin = perf_counter()
    for _ in range(100):
        turns.run_later("a", False, lambda: sleep(1e-3))
    turns.run_later("a", False, done.set)
    async with asyncio.timeout(30.0):
        await done.wait()
    assert perf_counter() - begin >= 0.1 + 0.06


# --- allowances -------------------------------------------------------------------------------------------


def rates(**more):
    return Rates(**({"client": 40.0, "identity": 1e9, "address": 1e9, "in_all": 1e9} | more))


def test_reservations_of_a_shared_bucket_queue_up():
    bucket = TokenBucket(rate=10.0, burst=2.0, now=0.0)
    assert [bucket.reserve(0.0) for _ in range(5)] == pytest.approx([0.0, 0.0, 0.1, 0.2, 0.3])
    assert bucket.reserve(1.0) == 0.0


@pytest.mark.parametrize(
    ("bound", "same"),
    [("identity", ("lab", "here", "lab", "there")), ("address", ("a", "here", "b", "here"))],
)
def test_clients_of_one_identity_or_address_share_a_rate_limit(bound, same):
    clock = Clock()
    allowances = RateLimits(rates(**{bound: 40.0}), clock)
    one, other = RateLimit(allowances, same[1]), RateLimit(allowances, same[3])
    one.identify(same[0])
    other.identify(same[2])
    stranger = RateLimit(allowances, "elsewhere")
    one.spend(30.0, own_limit_only=False)
    assert other.reserve(own_limit_only=False) == pytest.approx(21 / 40.0)
    assert other.reserve(own_limit_only=True) == 0.0
    assert stranger.reserve(own_limit_only=False) == 0.0


def test_all_clients_together_have_a_rate_limit_that_does_not_apply_to_holders():
    allowances = RateLimits(rates(in_all=40.0), Clock())
    for number in range(10):
        RateLimit(allowances, f"a{number}").reserve(own_limit_only=False)
    late = RateLimit(allowances, "late")
    assert late.reserve(own_limit_only=False) > 0.0
    assert late.reserve(own_limit_only=True) == 0.0


def test_a_bounded_number_of_identities_is_remembered_and_none_in_use_is_forgotten():
    clock = Clock()
    allowances = RateLimits(rates(identity=40.0), clock)
    busy = RateLimit(allowances, "busy")
    busy.spend(1e6, own_limit_only=False)
    for number in range(3000):
        clock.now += 0.01
        RateLimit(allowances, f"a{number}")
    assert len(allowances._shared) <= 1026
    assert RateLimit(allowances, "busy").reserve(own_limit_only=False) > 1.0
