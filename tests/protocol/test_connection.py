"""State machine of a connection: every combination of state, side and message, stated a second time."""

import itertools
from dataclasses import replace

import msgpack
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armgate.protocol import (
    DIALECTS,
    HANDSHAKE_LIMIT,
    INBOUND_LIMIT,
    Connection,
    ConnectionState,
    LocalProtocolError,
    Refusal,
    Side,
    decode,
    encode,
)
from armgate.protocol import messages as m
from armgate.protocol.connection import TRANSITIONS
from armgate.protocol.framing import HEADER, frame
from support.messages import FROM_CLIENT
from tools.spec.examples import messages as all_examples

State = ConnectionState
HELLO = m.Hello(versions=(1,), name="c")
FATAL = m.Error(code="malformed", text="", fatal=True)
LIMITS = m.Limits(inbound=1, outbound=1, max_age_ticks=3, lease_ttl=1.0, signals=1, signal_rate=1.0)
ROBOT = {"robot": "FR", "fence": 1}


def welcome(**more):
    fields = {
        "version": 1,
        "versions": (1,),
        "client_versions": (1,),
        "start": "a",
        "session": "b",
        "name": "c",
    }
    return m.Welcome(**fields | {"role": "observer", "limits": LIMITS} | more)


def examples(side, catalogue):
    """Return one message of each type that a side sends, by type: the minimal ones of the vectors."""
    minimal = [value for of, name, value in all_examples() if of == side and name.endswith(": minimal")]
    return {value["type"]: decode(msgpack.packb(value), catalogue) for value in minimal}


COMMAND = m.Command(**ROBOT, seq=1, tick=1, dq=(0.0,))
CLIENT_MESSAGES = examples("client", m.Catalogue.client) | {"hello": HELLO, "command": COMMAND}
SERVER_MESSAGES = examples("server", m.Catalogue.server) | {"welcome": welcome(), "fatal": FATAL}
MESSAGES = {Side.CLIENT: CLIENT_MESSAGES, Side.SERVER: SERVER_MESSAGES}
EVENTS = [(side, event) for side, messages in MESSAGES.items() for event in messages]


def expected(state, side, event):
    """Return the next state, stated independently of the table; None if the message is not allowed."""
    client = side is Side.CLIENT
    ordinary = event not in ("hello", "welcome", "bye", "fatal")
    match state:
        case State.CLOSED:
            return None
        case State.FAILED:
            return State.CLOSED if (client and event == "bye") or (not client and event == "fatal") else None
        case State.CLIENT_LEAVING:
            if client:
                return None
            # The welcome may cross a bye of the client that waits for it.
            return (
                State.CLOSED
                if event in ("bye", "fatal")
                else state
                if ordinary or event == "welcome"
                else None
            )
        case State.SERVER_LEAVING:
            if not client:
                return None
            return State.CLOSED if event == "bye" else state if ordinary else None
    if event == "bye":
        return State.CLIENT_LEAVING if client else State.SERVER_LEAVING
    if event == "fatal":
        return State.CLOSED
    if state is State.AWAIT_HELLO:
        return State.AWAIT_WELCOME if event == "hello" else None
    if state is State.AWAIT_WELCOME:
        return State.READY if event == "welcome" else None
    return state if ordinary else None


def connection(role, state):
    """Return a connection in a state, brought there by messages."""
    made = Connection(role)
    way = {
        State.AWAIT_HELLO: [],
        State.AWAIT_WELCOME: ["hello"],
        State.READY: ["hello", "welcome"],
        State.CLIENT_LEAVING: ["hello", "welcome", "client bye"],
        State.SERVER_LEAVING: ["hello", "welcome", "server bye"],
        State.FAILED: ["hello", "welcome", "garbage"],
        State.CLOSED: ["hello", "welcome", "client bye", "server bye"],
    }
    for step in way[state]:
        if step == "garbage":
            made.receive(bytes(HEADER))
            continue
        side = Side.CLIENT if step in ("hello", "client bye") else Side.SERVER
        message = MESSAGES[side][step.split()[-1]]
        if side is role:
            made.send(message)
        else:
            made.receive(encode(message))
    assert made.state is state
    return made


def test_a_client_that_sends_bye_before_the_welcome_still_reads_it():
    client, server = Connection(Side.CLIENT), Connection(Side.SERVER)
    server.receive(client.send(HELLO))
    crossing = server.send(welcome())
    server.receive(client.send(m.Bye()))
    messages = client.receive(crossing + server.send(m.Bye()))
    assert [type(message) for message in messages] == [m.Welcome, m.Bye]
    assert client.state is State.CLOSED


def test_every_message_of_the_protocol_is_covered():
    assert [type(message) for message in CLIENT_MESSAGES.values()] == list(m.CLIENT_MESSAGES)
    assert [type(message) for message in SERVER_MESSAGES.values()] == [*m.SERVER_MESSAGES, m.Error]


@pytest.mark.parametrize(("state", "event"), list(itertools.product(State, EVENTS)))
def test_the_table_equals_the_independent_statement(state, event):
    assert TRANSITIONS.get((state, *event)) is expected(state, *event)


@pytest.mark.parametrize(("state", "event"), list(itertools.product(State, EVENTS)))
def test_sending_is_allowed_in_exactly_the_states_of_the_table(state, event):
    side, name = event
    sender = connection(side, state)
    following = expected(state, side, name)
    if following is None:
        with pytest.raises(
            LocalProtocolError, match=f"the {side.value} may not send this in state {state.value}"
        ):
            sender.send(MESSAGES[side][name])
        assert sender.state is state
    else:
        assert sender.send(MESSAGES[side][name]) == encode(MESSAGES[side][name])
        assert sender.state is following


@pytest.mark.parametrize(("state", "event"), list(itertools.product(State, EVENTS)))
def test_receiving_is_allowed_in_exactly_the_states_of_the_table(state, event):
    side, name = event
    receiver = connection(side.other, state)
    following = expected(state, side, name)
    found = receiver.receive(encode(MESSAGES[side][name]))
    if state in (State.CLOSED, State.FAILED):
        assert (found, receiver.state) == ([], state)
    elif following is None:
        (refusal,) = found
        assert (refusal.fatal, refusal.error.code, receiver.state) == (True, "unexpected", State.FAILED)
        assert f"not allowed from the {side.value} in state {state.value}" in refusal.error.text
    else:
        assert found == [MESSAGES[side][name]]
        assert receiver.state is following


@pytest.mark.parametrize("event", EVENTS)
def test_both_sides_reach_the_same_state(event):
    side, name = event
    for state in (State.AWAIT_HELLO, State.AWAIT_WELCOME, State.READY):
        if expected(state, side, name) is None:
            continue
        sender, receiver = connection(side, state), connection(side.other, state)
        receiver.receive(sender.send(MESSAGES[side][name]))
        assert sender.state is receiver.state


# --- versions ---------------------------------------------------------------------------------------------


def dialects(*versions):
    return [replace(DIALECTS[0], version=version) for version in versions]


def test_the_server_chooses_the_highest_version_in_common():
    server = Connection(Side.SERVER, dialects(1, 2, 3))
    server.receive(encode(m.Hello(versions=(2, 1, 9), name="c")))
    assert (server.version, server.hello.versions) == (2, (2, 1, 9))


def test_no_version_in_common_is_fatal_and_names_both_lists():
    (refusal,) = Connection(Side.SERVER, dialects(1, 2)).receive(
        encode(m.Hello(versions=(9, 7), name="c", id=4))
    )
    assert (refusal.fatal, refusal.error.code, refusal.error.about) == (True, "version", "hello")
    assert refusal.error.re == 4
    assert "server supports [1, 2], the client [7, 9]" in refusal.error.text


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"versions": (1, 2), "client_versions": (1, 2)}, "chose version 1; both sides support 2"),
        (
            {"versions": (1, 2), "client_versions": (1,)},
            r"the server received the versions [1]; this client sent [1, 2]",
        ),
        ({"version": 2, "client_versions": (1, 2)}, "chose version 2; both sides support 1"),
        ({"version": 7, "versions": (7,), "client_versions": (1, 2)}, "no version in common"),
    ],
)
def test_the_client_detects_a_downgrade(change, told):
    client = Connection(Side.CLIENT, dialects(1, 2))
    client.send(m.Hello(versions=(1, 2), name="c"))
    (refusal,) = client.receive(encode(welcome(**change)))
    assert (refusal.fatal, refusal.error.code) == (True, "version")
    assert told in refusal.error.text
    assert client.state is State.FAILED


def test_the_client_learns_the_version_from_the_welcome():
    assert connection(Side.CLIENT, State.AWAIT_WELCOME).version is None
    assert connection(Side.CLIENT, State.READY).version == 1


# --- receiving --------------------------------------------------------------------------------------------


def test_a_refused_message_does_not_affect_the_others():
    server = connection(Side.SERVER, State.READY)
    ping = encode(m.Ping(time=1.0))
    tea = frame(msgpack.packb({"type": "tea"}))
    first, refusal, last = server.receive(ping + tea + ping)
    assert isinstance(first, m.Ping)
    assert isinstance(last, m.Ping)
    assert (refusal.fatal, refusal.error.code) == (False, "unknown_type")
    assert server.send(refusal.error)
    assert server.state is State.READY


def test_after_a_fatal_refusal_only_the_error_may_be_sent():
    server = connection(Side.SERVER, State.READY)
    ping = encode(m.Ping(time=1.0))
    _, refusal = server.receive(ping + frame(b"\xc1") + ping)
    assert refusal.fatal
    assert server.receive(ping) == []
    with pytest.raises(LocalProtocolError):
        server.send(SERVER_MESSAGES["state"])
    server.send(refusal.error)
    assert server.closed
    with pytest.raises(LocalProtocolError):
        server.send(refusal.error)


@pytest.mark.parametrize(
    "payload", [{"type": "tea"}, {"type": "hello"}, {"type": "hello", "versions": "1"}, {}]
)
def test_before_the_welcome_every_refusal_is_fatal(payload):
    for state in (State.AWAIT_HELLO, State.AWAIT_WELCOME):
        server = connection(Side.SERVER, state)
        (refusal,) = server.receive(frame(msgpack.packb(payload)))
        assert refusal.fatal
        assert server.state is State.FAILED


def test_a_refusal_of_a_message_out_of_turn_repeats_its_id_or_seq():
    (refusal,) = connection(Side.SERVER, State.AWAIT_HELLO).receive(encode(m.Describe(id=7)))
    assert (refusal.error.code, refusal.error.about, refusal.error.re) == ("unexpected", "describe", 7)
    (refusal,) = connection(Side.SERVER, State.AWAIT_HELLO).receive(encode(CLIENT_MESSAGES["command"]))
    assert (refusal.error.about, refusal.error.seq) == ("command", 1)


@pytest.mark.parametrize(
    ("role", "state", "limit"),
    [
        (Side.SERVER, State.AWAIT_HELLO, 4 * 1024),
        (Side.SERVER, State.AWAIT_WELCOME, 4 * 1024),
        (Side.SERVER, State.READY, 64 * 1024),
        (Side.CLIENT, State.AWAIT_WELCOME, 1024 * 1024),
        (Side.CLIENT, State.READY, 1024 * 1024),
    ],
)
def test_inbound_limits(role, state, limit):
    def header(length):
        return length.to_bytes(HEADER, "big")

    assert connection(role, state).receive(header(limit)) == []
    for length in (limit + 1, 2**32 - 1):
        (refusal,) = connection(role, state).receive(header(length))
        assert (refusal.fatal, refusal.error.code) == (True, "frame_too_large")


@pytest.mark.parametrize(
    ("state", "limit"), [(State.AWAIT_HELLO, HANDSHAKE_LIMIT), (State.READY, INBOUND_LIMIT)]
)
def test_a_client_does_not_send_payloads_beyond_the_servers_limit(state, limit):
    client = connection(Side.CLIENT, state)
    if state is State.READY:
        message = m.Command.model_construct(**ROBOT, seq=1, tick=1, dq=(0.0,) * (limit // 9 + 1))
    else:
        message = m.Hello.model_construct(versions=(1,), name="c", software="x" * limit)
    with pytest.raises(LocalProtocolError, match=f"at most {limit}"):
        client.send(message)
    assert client.state is state


def test_an_encoded_frame_is_sent_unchanged_if_the_message_is_allowed():
    state = SERVER_MESSAGES["state"]
    assert connection(Side.SERVER, State.READY).send(state, b"made before") == b"made before"
    with pytest.raises(LocalProtocolError):
        connection(Side.SERVER, State.AWAIT_WELCOME).send(state, b"made before")


def test_the_end_of_the_stream_closes_the_connection():
    server = connection(Side.SERVER, State.READY)
    assert server.receive_eof() == []
    assert server.closed
    server = connection(Side.SERVER, State.READY)
    server.receive(encode(m.Ping(time=0.0))[:-1])
    (refusal,) = server.receive_eof()
    assert (refusal.error.code, server.closed) == ("truncated", True)
    failed = connection(Side.SERVER, State.FAILED)
    assert failed.receive_eof() == []


def run(stream, pieces):
    """Return everything that a server reads from a stream; the server answers hello at once."""
    server = Connection(Side.SERVER)
    found = []
    for piece in pieces(stream):
        for item in server.receive(piece):
            found.append(item.error if isinstance(item, Refusal) else item)
            if isinstance(item, m.Hello):
                server.send(welcome(client_versions=item.versions))
    found += [refusal.error for refusal in server.receive_eof()]
    return repr(found)


def whole(stream):
    """Divide the stream after the hello: a client waits for the welcome first."""
    first = len(encode(HELLO))
    return [stream[:first], stream[first:]]


def single(stream):
    return [stream[i : i + 1] for i in range(len(stream))]


CONVERSATIONS = st.lists(
    st.one_of(
        *(s.map(encode) for model, s in FROM_CLIENT.items() if model is not m.Hello), st.binary(max_size=30)
    ),
    max_size=5,
)


@settings(max_examples=60)
@given(CONVERSATIONS)
def test_a_conversation_gives_the_same_result_byte_by_byte(ordinary):
    stream = encode(HELLO) + b"".join(ordinary)
    assert run(stream, whole) == run(stream, single)


@given(st.binary(max_size=200))
def test_garbage_gives_the_same_result_byte_by_byte(stream):
    assert run(stream, lambda s: [s]) == run(stream, single)


# --- stops that overtake other messages -------------------------------------------------------------------


def pushed(*messages):
    """Return a server that has received these messages and popped none."""
    client, server = connection(Side.CLIENT, State.READY), connection(Side.SERVER, State.READY)
    server.push(b"".join(x if isinstance(x, bytes) else client.send(x) for x in messages))
    return server


def popped(server):
    return list(iter(server.pop, None))


PING, STOP = m.Ping(time=1.0), m.Stop(reason="now")


@pytest.mark.parametrize(("before", "after"), [(0, 0), (1, 0), (0, 1), (50, 50), (3000, 0)])
def test_a_stop_overtakes_and_the_other_messages_keep_their_order(before, after):
    first = [m.Ping(time=float(i)) for i in range(before)]
    last = [m.Ping(time=float(i)) for i in range(after)]
    server = pushed(*first, STOP, *last)
    taken = [server.overtake() for _ in range(50)]
    assert [x for x in taken if x is not None] == [STOP]
    assert popped(server) == first + last


def test_several_stops_overtake_in_order_while_other_messages_are_popped():
    stops = [m.Stop(reason=f"{i}") for i in range(3)]
    server = pushed(PING, stops[0], PING, stops[1], PING, stops[2], PING)
    assert server.overtake() == stops[0]
    assert server.pop() == PING
    assert [server.overtake(), server.overtake(), server.overtake()] == [*stops[1:], None]
    assert popped(server) == [PING] * 3


@pytest.mark.parametrize("cut", range(1, 25))
def test_an_incomplete_stop_does_not_overtake(cut):
    data = connection(Side.CLIENT, State.READY).send(STOP)
    server = pushed(PING, data[:cut])
    assert server.overtake() is None
    assert not server.may_overtake  # until more bytes arrive there is nothing to inspect
    server.push(data[cut:])
    assert server.overtake() == STOP
    assert popped(server) == [PING]


@pytest.mark.parametrize(
    "wall", [frame(b"\xc1"), encode(m.Bye()), frame(b"\x80" + b"x"), b"\x00\x00\x00\x00", b"\xff\xff\xff\xff"]
)
def test_a_stop_behind_a_bye_or_a_fatal_fault_does_not_overtake(wall):
    server = pushed(PING, wall, STOP)
    assert [server.overtake() for _ in range(3)] == [None] * 3
    assert server.pop() == PING


@pytest.mark.parametrize(
    "packed", [b"\x82\xa4type\xd9\x04stop\xa2id\x01", b"\x83\xa3new\x01\xa4type\xa4stop\xa6reason\xa0"]
)
def test_a_stop_in_any_encoding_overtakes(packed):
    assert isinstance(pushed(PING, frame(packed)).overtake(), m.Stop)


@pytest.mark.parametrize("other", [m.Signal(name="stop", value=(1.0,)), m.Stop.model_construct(robot="")])
def test_an_invalid_stop_and_a_signal_named_stop_do_not_overtake(other):
    server = pushed(PING, encode(other), STOP)
    assert server.overtake() == STOP
    first, second = popped(server)
    assert first == PING
    assert second == other or isinstance(second, Refusal)


def test_a_reset_that_a_stop_overtook_is_refused_and_a_later_one_is_not():
    before, after = m.Reset(id=1, stop=5), m.Reset(id=2, stop=6)
    server = pushed(PING, before, PING, STOP, PING, after)
    assert [server.overtake(), server.overtake()] == [STOP, None]
    first, refusal, *rest = popped(server)
    assert (first, rest) == (PING, [PING, PING, after])
    error = refusal.error
    assert (error.code, error.fatal, error.about, error.re) == ("unknown_stop", False, "reset", 1)


def test_one_call_inspects_a_bounded_number_of_bytes_and_locates_no_fault(monkeypatch):
    monkeypatch.setattr("armgate.protocol.codec.offset_of", None)
    invalid = frame(msgpack.packb({"type": "stop", "robot": 5, "pad": [[1] * 250] * 15}))
    server = pushed(invalid * 60)
    calls = 0
    while server.may_overtake:
        assert server.overtake() is None
        calls += 1
    assert calls >= 30


def test_no_message_overtakes_before_the_welcome_or_at_a_client():
    server = connection(Side.SERVER, State.AWAIT_HELLO)
    server.push(encode(STOP))
    assert server.overtake() is None
    client = connection(Side.CLIENT, State.READY)
    client.push(encode(m.Stopped(stop=1, robots=(), reason="", by="c")))
    assert client.overtake() is None
