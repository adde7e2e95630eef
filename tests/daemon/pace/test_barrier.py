"""Who is waited for in lock-step."""

import pytest

from armgate.daemon.pace.barrier import Barrier, Presence
from armgate.protocol import RemoteProtocolError


class Leased:
    """A barrier of two with leases to be set."""

    def __init__(self, **held):
        self.held = held
        self.barrier = Barrier(("a", "b"), 10.0, lambda name: self.held.get(name, set()))
        self.barrier.begin(0, ["A", "B"], 0.0)
        self.barrier.join("a", 0.0)
        self.barrier.join("b", 0.0)


def test_a_step_needs_everybodys_commands():
    leased = Leased(a={"A"}, b={"B"})
    leased.barrier.command("a", "A")
    assert leased.barrier.done("a")
    assert not leased.barrier.complete
    leased.barrier.command("b", "B")
    assert leased.barrier.complete
    leased.barrier.begin(1, ["A", "B"], 0.0)
    assert not leased.barrier.complete


def test_who_holds_two_robots_commands_both_or_passes():
    leased = Leased(a={"A", "B"})
    leased.barrier.command("a", "A")
    assert not leased.barrier.done("a")
    leased.barrier.pass_("a", 0)
    assert leased.barrier.done("a")


def test_who_holds_no_robot_must_pass():
    leased = Leased(a={"A"})
    leased.barrier.command("a", "A")
    assert not leased.barrier.done("b")
    leased.barrier.pass_("b", 0)
    assert leased.barrier.complete


def test_who_holds_only_robots_that_did_not_tick_has_nothing_to_say():
    leased = Leased(a={"A"}, b={"B"})
    leased.barrier.begin(1, ["A"], 0.0)
    assert leased.barrier.done("b")
    leased.barrier.command("a", "A")
    assert leased.barrier.complete


def test_the_absent_are_waited_for_the_gone_and_dropped_are_not():
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


def test_with_nobody_left_nothing_goes_on():
    barrier = Barrier(("a",), 10.0, lambda name: set())
    barrier.begin(0, ["A"], 0.0)
    barrier.join("a", 0.0)
    barrier.pass_("a", 0)
    barrier.leave("a")
    assert not barrier.complete


@pytest.mark.parametrize("step", [1, 3])
def test_a_pass_for_another_step_is_refused(step):
    leased = Leased()
    leased.barrier.begin(2, ["A"], 0.0)
    with pytest.raises(RemoteProtocolError, match="the current one is 2") as caught:
        leased.barrier.pass_("a", step)
    assert caught.value.code.value == "wrong_step"


def test_silence_is_counted_from_the_last_sign_of_life_while_waited_for():
    leased = Leased()
    leased.barrier.pass_("a", 0)
    assert leased.barrier.silent(9.9) == []
    assert leased.barrier.silent(10.0) == ["b"]
    leased.barrier.note_message("b", 5.0)
    assert leased.barrier.silent(14.9) == []
    assert leased.barrier.silent(15.0) == ["b"]
    absent = Barrier(("c",), 1.0, lambda name: set())
    absent.begin(0, ["A"], 0.0)
    assert absent.silent(1e9) == []
