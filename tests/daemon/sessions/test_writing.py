"""Answers are never dropped, and unread states never pile up."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from armgate.daemon.sessions.writing import Outbox, Overflow


class Pipe:
    """A transport that takes some frames, then none until it is drained."""

    def __init__(self, room=10**9, limit=100):
        self.taken = []
        self.room = room
        self.reads = True
        self.outbox = Outbox(self.write, limit, lambda: self.reads)

    def write(self, frame):
        self.taken.append(frame)
        if len(self.taken) >= self.room:
            self.outbox.pause()

    def drain(self, room):
        self.room = len(self.taken) + room
        self.outbox.resume()


def test_a_client_that_reads_gets_everything_at_once():
    pipe = Pipe()
    pipe.outbox.put(b"v1")
    pipe.outbox.put_states({"A": b"s1"})
    pipe.outbox.put_states({"A": b"s2"})
    assert pipe.taken == [b"v1", b"s1", b"s2"]
    assert pipe.outbox.empty


def test_a_slow_client_gets_every_verdict_and_the_latest_state_of_each_robot():
    pipe = Pipe(room=1)
    pipe.outbox.put(b"v0")
    for number in range(1, 5):
        pipe.outbox.put(b"v%d" % number)
        pipe.outbox.put_states({"A": b"a%d" % number})
        pipe.outbox.put_states({"B": b"b%d" % number})
    assert pipe.taken == [b"v0"]
    pipe.drain(room=100)
    assert pipe.taken == [b"v0", b"v1", b"v2", b"v3", b"v4", b"a4b4"]
    assert pipe.outbox.empty


def test_states_wait_for_a_client_that_does_not_read_and_answers_do_not():
    pipe = Pipe()
    pipe.reads = False
    pipe.outbox.put_states({"A": b"a1", "B": b"b1"})
    pipe.outbox.put_states({"A": b"a2"})
    pipe.outbox.put(b"v1")
    assert (pipe.taken, pipe.outbox.states_wait) == ([b"v1"], True)
    pipe.reads = True
    pipe.outbox.write_states()
    assert (pipe.taken, pipe.outbox.states_wait) == ([b"v1", b"b1a2"], False)


def test_states_of_a_subscription_that_ended_are_dropped():
    pipe = Pipe()
    pipe.reads = False
    pipe.outbox.put_states({"A": b"a1", "B": b"b1"})
    pipe.outbox.drop_states()
    pipe.outbox.put(b"subscribed")
    pipe.reads = True
    pipe.outbox.put_states({"B": b"b2"})
    assert pipe.taken == [b"subscribed", b"b2"]


def test_too_many_unread_answers_are_an_overflow_and_states_are_not():
    pipe = Pipe(room=0, limit=10)
    pipe.outbox.pause()
    for _ in range(1000):
        pipe.outbox.put_states({"A": b"x" * 1000})
    pipe.outbox.put(b"12345")
    pipe.outbox.put(b"67890")
    with pytest.raises(Overflow, match="10 bytes wait"):
        pipe.outbox.put(b"1")


@given(st.lists(st.one_of(st.just("verdict"), st.just("state"), st.integers(1, 4)), max_size=60))
def test_verdicts_are_written_in_order_whenever_the_client_reads(actions):
    pipe = Pipe(room=1, limit=10**6)
    sent, states = [], 0
    for action in actions:
        if action == "verdict":
            sent.append(b"v%d" % len(sent))
            pipe.outbox.put(sent[-1])
        elif action == "state":
            states += 1
            pipe.outbox.put_states({"A": b"s%d" % states})
        else:
            pipe.drain(action)
    pipe.drain(10**6)
    assert [frame for frame in pipe.taken if frame.startswith(b"v")] == sent
    numbers = [int(frame[1:]) for frame in pipe.taken if frame.startswith(b"s")]
    assert numbers == sorted(set(numbers))
    assert not states or numbers[-1] == states
