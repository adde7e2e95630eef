"""Participants that a step of lock-step waits for."""

import pytest

from armgate.protocol import RemoteProtocolError
from armgate.world.barrier import Barrier, Presence


class LeasedBarrier:
    """A barrier of two participants, with leases that the test sets."""

    def __init__(self, **held):
        self.held = held
        self.barrier = Barrier(("a", "b"), 10.0, lambda name: self.held.get(name, set()))
        self.barrier.begin(0, ["A", "B"], 0.0)
        self.barrier.join("a", 0.0)
        self.barrier.join("b", 0.0)


def test_a_step_needs_the_commands_of_all_participants():
    leased = LeasedBarrier(a={"A"}, b={"B"})
    leased.barrier.command("a", "A")
    assert leased.barrier.done("a")
    assert not leased.barrier.complete
    leased.barrier.command("b", "B")
    assert leased.barrier.complete
    leased.barrier.begin(1, ["A", "B"], 0.0)
    assert not leased.barrier.complete


def test_a_holder_of_two_robots_commands_both_or_passes():
    leased = LeasedBarrier(a={"A", "B"})
    leased.barrier.command("a", "A")
    assert not leased.barrier.done("a")
    leased.barrier.pass_("a", 0)
    assert leased.barrier.done("a")


def test_a_participant_without_a_robot_must_pass():
    leased = LeasedBarrier(a={"A"})
    leased.barrier.command("a", "A")
    assert not leased.barrier.done("b")
    leased.barrier.pass_("b", 0)
    assert leased.barrier.complete


def test_a_holder_of_robots_that_did_not_tick_is_done_at_once():
    leased = LeasedBarrier(a={"A"}, b={"B"})
    leased.barrier.begin(1, ["A"], 0.0)
    assert leased.barrier.done("b")
    leased.barrier.command("a", "A")
    assert leased.barrier.complete


def test_a_step_waits_for_absent_participants_and_not_for_gone_or_dropped_ones():
    barrier = Barrier(("a", "b"), 10.0, lambda name: set())
    barrier.begin(0, ["A"], 0.0)
    assert not barrier.complete
    barrier.join("a", 0.0)
    barrier.pass_("a", 0)
    assert not barrier.complete
    barrier.join("b", 0.0)
    barrier.leave("b")
    assert barrier.presence("b") is Presence.GONE
    assert barrier.complete
    barrier.join("b", 0.0)
    assert not barrier.complete
    barrier.drop("b")
    barrier.leave("b")
    assert barrier.presence("b") is Presence.DROPPED
    assert barrier.complete


def test_without_participants_no_step_is_complete():
    barrier = Barrier(("a",), 10.0, lambda name: set())
    barrier.begin(0, ["A"], 0.0)
    barrier.join("a", 0.0)
    barrier.pass_("a", 0)
    barrier.leave("a")
    assert not barrier.complete


@pytest.mark.parametrize("step", [1, 3])
def test_a_pass_for_another_step_is_refused(step):
    leased = LeasedBarrier()
    leased.barrier.begin(2, ["A"], 0.0)
    with pytest.raises(RemoteProtocolError, match="the current one is 2") as caught:
        leased.barrier.pass_("a", step)
    assert caught.value.code.value == "wrong_step"


def test_the_grace_counts_from_the_last_message_while_a_step_waits():
    leased = LeasedBarrier()
    leased.barrier.pass_("a", 0)
    assert leased.barrier.silent(9.9) == []
    assert leased.barrier.silent(10.0) == ["b"]
    leased.barrier.note_message("b", 5.0)
    assert leased.barrier.silent(14.9) == []
    assert leased.barrier.silent(15.0) == ["b"]
    absent = Barrier(("c",), 1.0, lambda name: set())
    absent.begin(0, ["A"], 0.0)
    assert absent.silent(1e9) == []
