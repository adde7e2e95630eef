"""Plans are played once, from their own tick on, or not at all."""

import pytest
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from armgate.events import Plan, PlanKey, Rebase
from armgate.links.emulated.link import EmulatedLink
from armgate.links.plan_player import PlanPlayer, Played

START = "d1"


def plan(target, increments=((0.1,), (0.05,)), last=-1, resets=0, start=START, seq=0):
    return Plan("A", PlanKey(start, resets, target, last), seq, tuple(increments))


@pytest.fixture
def player():
    player = PlanPlayer("A", START)
    player.play()
    return player


def test_a_plan_is_played_to_its_end(player):
    p = plan(1)
    assert player.offer(p).accepted
    assert player.remaining == 2
    assert player.play() == Played((0.1,), p.key, 0)
    assert player.remaining == 1
    assert player.play() == Played((0.05,), p.key, 1)
    assert player.remaining == 0
    assert player.play() == Played()
    assert player.play() == Played()


@pytest.mark.parametrize(
    ("offered", "reason"),
    [
        (plan(0), "late"),
        (plan(2), "early"),
        (plan(1, last=0), "mismatch"),
        (plan(1, resets=1), "mismatch"),
        (plan(1, start="d0"), "mismatch"),
    ],
)
def test_a_plan_made_for_another_increment_is_refused(player, offered, reason):
    answer = player.offer(offered)
    assert (answer.accepted, answer.reason, answer.key, answer.robot) == (False, reason, offered.key, "A")
    assert player.play() == Played()


def test_the_first_plan_for_a_tick_is_the_only_one(player):
    first, second = plan(1, seq=1), plan(1, seq=2)
    assert player.offer(first).accepted
    assert player.offer(second).reason == "mismatch"
    assert player.play().increment == (0.1,)


def test_the_same_plan_again_gets_the_same_answer_and_is_not_played_again(player):
    p = plan(1)
    answers = [player.offer(p)]
    player.play()
    answers.append(player.offer(p))
    player.play()
    player.play()
    answers.append(player.offer(p))
    assert answers == [answers[0]] * 3
    assert answers[0].accepted
    assert player.play() == Played()


def test_without_a_next_plan_the_old_one_runs_out(player):
    first = plan(1, [(0.3,), (0.2,), (0.1,)])
    player.offer(first)
    player.play()
    replacing = plan(2, [(0.4,)], last=0)
    player.play()  # the replacing plan comes after its tick
    assert player.offer(replacing).reason == "late"
    assert player.play().increment == (0.1,)
    assert player.play() == Played()


def test_a_rebase_drops_the_held_plan_and_refuses_earlier_ones(player):
    player.offer(plan(1))
    player.rebase(Rebase("A", (0.0,), 1))
    assert player.remaining == 0
    assert player.offer(plan(1, seq=7)).reason == "mismatch"
    assert player.play() == Played()
    assert player.offer(plan(2, resets=1)).accepted


def test_the_number_of_kept_answers_is_bounded(player):
    for seq in range(1000):
        player.offer(plan(5, seq=seq))
    assert len(player._answers) == 64


class Playing(RuleBasedStateMachine):
    """A link under plans that come in any order, twice, late, early, or never."""

    def __init__(self):
        super().__init__()
        self.link = EmulatedLink("A", START, (0.5,), 0.012, 0.0)
        self.last = self.link.advance(0.0)
        self.resets = 0
        self.seen = []
        self.accepted = {}
        self.played = {}
        self.pending = None
        self.setpoint = 0.5

    increments = st.lists(st.tuples(st.integers(-8, 8).map(lambda k: k / 64)), min_size=1, max_size=4)

    @rule(
        steps=increments,
        shift=st.integers(-2, 2),
        index=st.integers(-1, 3),
        right=st.booleans(),
        resets=st.integers(0, 2),
    )
    def offer(self, steps, shift, index, right, resets):
        key = PlanKey(START, self.resets, self.last.tick + 1, self.last.index)
        if not right:
            key = PlanKey(START, resets, self.last.tick + 1 + shift, index)
        new = Plan("A", key, len(self.seen), tuple(steps))
        free = self.pending is None
        answer = self.link.offer(new)
        should = key == PlanKey(START, self.resets, self.last.tick + 1, self.last.index) and free
        assert answer.accepted == should
        if answer.accepted:
            self.pending = new
        self.seen.append((new, answer))

    @precondition(lambda self: self.seen)
    @rule(data=st.data())
    def offer_again(self, data):
        old, answer = data.draw(st.sampled_from(self.seen))
        before = self.link.remaining
        assert self.link.offer(old) == answer
        assert self.link.remaining == before

    @rule()
    def tick(self):
        before, waiting = self.last, self.pending
        self.last = tick = self.link.advance((before.tick + 1) * 0.012)
        self.pending = None
        assert tick.tick == before.tick + 1
        assert tick.q == before.setpoint  # no lag
        self.setpoint += tick.increment[0]
        if waiting is not None:
            self.accepted[waiting.key] = waiting
            assert (tick.plan, tick.index) == (waiting.key, 0)
            assert tick.plan.target == tick.tick
        if tick.plan is None:
            assert (tick.index, tick.increment) == (-1, (0.0,))
        else:
            assert tick.increment == self.accepted[tick.plan].increments[tick.index]
            assert tick.plan.target + tick.index == tick.tick  # never after its time
            assert self.played.setdefault((tick.plan, tick.index), tick.tick) == tick.tick  # never twice

    @rule(setpoint=st.integers(-8, 8).map(lambda k: k / 8))
    def rebase(self, setpoint):
        self.resets += 1
        self.link.rebase(Rebase("A", (setpoint,), self.resets))
        self.setpoint, self.pending = setpoint, None
        # The gate receives a rebase with the tick after it; until then it offers no plan.
        before = self.last
        self.last = self.link.advance((before.tick + 1) * 0.012)
        assert (self.last.plan, self.last.setpoint) == (None, (setpoint,))

    @rule()
    def no_further_plan(self):
        for _ in range(self.link.remaining):
            self.tick()
        self.tick()
        assert self.last.plan is None
        assert self.link.remaining == 0

    @invariant()
    def setpoint_is_the_sum_of_played_increments(self):
        assert self.last.setpoint == (self.setpoint,)


TestPlaying = Playing.TestCase
