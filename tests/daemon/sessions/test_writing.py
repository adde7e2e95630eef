"""Answers are never dropped, and unread states never pile up."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from armgate.daemon.sessions.writing import Overflow, Writer
from support.clients import until


class Pipe:
    """A transport with its socket, which accepts some frames, then none until it is drained."""

    def __init__(self, room=10**9, limit=100):
        self.taken = []
        self.room = room
        self.reads = True
        self.writer = Writer(limit)
        self.writer.connect(self, self)

    def write(self, frame):
        self.taken.append(frame)
        if len(self.taken) >= self.room:
            self.writer.pause()

    def is_closing(self):
        return False

    def is_read(self):
        return self.reads

    def drain(self, room):
        self.room = len(self.taken) + room
        self.writer.resume()

    def send(self, frame):
        self.writer.send(frame, delayable=False)


def test_a_client_that_reads_gets_everything_at_once():
    pipe = Pipe()
    pipe.send(b"v1")
    pipe.writer.send_states({"A": b"s1"})
    pipe.writer.send_states({"A": b"s2"})
    assert pipe.taken == [b"v1", b"s1", b"s2"]
    assert pipe.writer.size == 0


def test_a_slow_client_gets_every_verdict_and_the_latest_state_of_each_robot():
    pipe = Pipe(room=1)
    pipe.send(b"v0")
    for number in range(1, 5):
        pipe.send(b"v%d" % number)
        pipe.writer.send_states({"A": b"a%d" % number})
        pipe.writer.send_states({"B": b"b%d" % number})
    assert pipe.taken == [b"v0"]
    pipe.drain(room=100)
    assert pipe.taken == [b"v0", b"v1", b"v2", b"v3", b"v4", b"a4b4"]
    assert pipe.writer.size == 0


async def test_states_wait_for_a_client_that_does_not_read_and_answers_do_not():
    pipe = Pipe()
    pipe.reads = False
    pipe.writer.send_states({"A": b"a1", "B": b"b1"})
    pipe.writer.send_states({"A": b"a2"})
    pipe.send(b"v1")
    assert (pipe.taken, pipe.writer.size) == ([b"v1"], 4)
    pipe.reads = True
    await until(lambda: len(pipe.taken) == 2)
    assert (pipe.taken, pipe.writer.size) == ([b"v1", b"b1a2"], 0)


async def test_states_of_a_subscription_that_ended_are_dropped():
    pipe = Pipe()
    pipe.reads = False
    pipe.writer.send_states({"A": b"a1", "B": b"b1"})
    pipe.writer.drop_states()
    pipe.send(b"subscribed")
    pipe.reads = True
    pipe.writer.send_states({"B": b"b2"})
    assert pipe.taken == [b"subscribed", b"b2"]


def test_kept_states_wait_in_order_with_answers_up_to_the_limit():
    pipe = Pipe(room=1, limit=10)
    pipe.reads = False
    pipe.writer.keep_states()
    pipe.writer.send_states({"A": b"a1", "B": b"b1"})
    pipe.send(b"v1")
    pipe.writer.drop_states()
    pipe.writer.send_states({"A": b"a2"})
    assert (pipe.taken, pipe.writer.size) == ([b"a1"], 6)
    with pytest.raises(Overflow, match="6 bytes wait"):
        pipe.writer.send_states({"A": b"12345"})
    pipe.drain(room=100)
    assert pipe.taken == [b"a1", b"b1", b"v1", b"a2"]


def test_too_many_unread_answers_are_an_overflow_and_states_are_not():
    pipe = Pipe(room=0, limit=10)
    pipe.writer.pause()
    for _ in range(1000):
        pipe.writer.send_states({"A": b"x" * 1000})
    pipe.send(b"12345")
    pipe.send(b"67890")
    with pytest.raises(Overflow, match="10 bytes wait"):
        pipe.send(b"1")


def test_delayable_messages_wait_until_the_last_open_batch_closes():
    pipe = Pipe()
    first, second = pipe.writer.batch(), pipe.writer.batch()
    pipe.writer.send(b"v1", delayable=True)
    pipe.writer.send_states({"A": b"a1"})
    first.close()
    first.close()
    assert pipe.taken == []
    second.close()
    assert pipe.taken == [b"v1a1"]


def test_a_message_that_may_not_be_delayed_is_written_after_the_messages_that_a_batch_holds():
    pipe = Pipe()
    with pipe.writer.batch():
        pipe.writer.send(b"v1", delayable=True)
        pipe.send(b"e1")
        assert pipe.taken == [b"v1e1"]
        pipe.writer.send(b"v2", delayable=True)
    assert pipe.taken == [b"v1e1", b"v2"]


@given(st.lists(st.one_of(st.just("verdict"), st.just("state"), st.integers(1, 4)), max_size=60))
def test_verdicts_are_written_in_order_whenever_the_client_reads(actions):
    pipe = Pipe(room=1, limit=10**6)
    sent, states = [], 0
    for action in actions:
        if action == "verdict":
            sent.append(b"v%d" % len(sent))
            pipe.send(sent[-1])
        elif action == "state":
            states += 1
            pipe.writer.send_states({"A": b"s%d" % states})
        else:
            pipe.drain(action)
    pipe.drain(10**6)
    assert [frame for frame in pipe.taken if frame.startswith(b"v")] == sent
    numbers = [int(frame[1:]) for frame in pipe.taken if frame.startswith(b"s")]
    assert numbers == sorted(set(numbers))
    assert not states or numbers[-1] == states
