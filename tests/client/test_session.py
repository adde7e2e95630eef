"""Session of the SDK without sockets; times are arguments."""

import socket

import pytest

from armgate.client import BadArgument, ConnectionLost, Lost, Refused, Rejected, Tick, TimedOut
from armgate.client import errors as client_errors
from armgate.client.pending import KEPT_VERDICTS
from armgate.client.security import no_connection
from armgate.client.session import Session, build
from armgate.protocol import CODES, Connection, ErrorCode, Side
from armgate.protocol import messages as m
from support.fake_server import FakeServer, state, verdict


class Pair:
    """Session and the server's side of its connection."""

    def __init__(self, ttl=0.9):
        self.session = Session()
        self.server = Connection(Side.SERVER)
        self.fake = FakeServer()
        self.fake.ttl = ttl
        self.forward(self.session.hello("c", "controller", None, ""))

    def receive(self, data):
        return self.server.receive(data)

    def send(self, message):
        self.session.receive(self.server.send(message))

    def forward(self, data):
        for message in self.receive(data):
            for reply in getattr(self.fake, f"_{message.type}")(message):
                self.send(reply)

    def acquire(self, robot="FR"):
        number, data = self.session.ask(m.Acquire(robot=robot))
        self.forward(data)
        return self.session.pending.answer(number, m.Lease)


def test_a_ping_is_due_after_a_third_of_the_time_to_live():
    pair = Pair(ttl=0.9)
    pair.acquire()
    pair.session.sent(10.0)
    assert pair.session.keepalive(10.29) == b""
    (ping,) = pair.receive(pair.session.keepalive(10.3))
    assert (ping.type, ping.time) == ("ping", 10.3)
    pair.session.sent(10.3)
    assert pair.session.keepalive(10.59) == b""


def test_the_shortest_lease_determines_when_a_ping_is_due():
    pair = Pair(ttl=0.9)
    pair.session.sent(10.0)
    assert pair.session.keepalive_due == pytest.approx(10.3)
    pair.acquire("FR")
    pair.fake.ttl = 0.3
    fence = pair.acquire("GR").fence
    assert pair.session.keepalive_due == pytest.approx(10.1)
    pair.send(pair.fake.lost("GR", fence, "x"))
    assert pair.session.keepalive_due == pytest.approx(10.3)


def test_no_ping_is_due_before_the_welcome_or_after_the_end():
    session = Session()
    session.hello("c", "controller", None, "")
    assert session.keepalive(1e9) == b""
    pair = Pair()
    pair.session.bye()
    assert pair.session.keepalive(1e9) == b""


def test_silence_counts_from_the_first_ping_without_a_reaction():
    pair = Pair()
    session = pair.session
    session.check_silence(1e9, 5.0)
    session.keepalive(100.0)
    session.keepalive(104.0)
    session.check_silence(105.0, 5.0)
    with pytest.raises(TimedOut, match="silent for 5 s"):
        session.check_silence(105.1, 5.0)
    pair.send(state())
    session.check_silence(1e9, 5.0)


def test_seq_increases_over_all_robots_of_a_session():
    pair = Pair()
    pair.acquire("FR")
    pair.acquire("GR")
    numbers = [pair.session.command(robot, fence, 0, [0.0])[0] for robot, fence in (("FR", 1), ("GR", 2)) * 2]
    assert numbers == [1, 2, 3, 4]


def test_a_command_without_a_lease_is_not_sent():
    pair = Pair()
    pair.acquire("FR")
    with pytest.raises(Lost, match="released the robot or acquired it again"):
        pair.session.command("FR", 99, 0, [0.0])
    with pytest.raises(Lost):
        pair.session.command("GR", 1, 0, [0.0])


def test_a_tick_that_already_has_a_command_is_not_returned():
    pair = Pair()
    pair.acquire("FR")
    # A command based on tick 5 and decided at tick 6 is for tick 7.
    pair.send(state(tick=5))
    command = m.Command(robot="FR", fence=1, seq=1, tick=5, dq=())
    pair.send(verdict(command, target=7))
    pair.send(state(tick=6))
    assert pair.session.next_tick("FR", 1, 5) is None
    pair.send(state(tick=7))
    assert pair.session.next_tick("FR", 1, 5).tick == 7


def test_unread_verdicts_are_bounded():
    pair = Pair()
    command = m.Command(robot="FR", fence=1, seq=0, tick=0, dq=())
    for seq in range(KEPT_VERDICTS + 10):
        pair.session.pending.take_verdict(verdict(command, seq=seq))
    kept = pair.session.pending.verdicts("FR")
    assert [verdict.seq for verdict in kept] == list(range(10, KEPT_VERDICTS + 10))


def test_an_answer_of_another_type_is_an_error():
    pair = Pair()
    number, data = pair.session.ask(m.Ping(time=0.0))
    (ping,) = pair.receive(data)
    pair.send(m.Signaled(re=ping.id, name="x"))
    with pytest.raises(ConnectionLost, match="answered with signaled; expected Pong"):
        pair.session.pending.answer(number, m.Pong)


def test_unexpected_answers_are_dropped():
    pair = Pair()
    pair.send(m.Pong(re=12345, time=0.0, received=0.0, sent=0.0))
    assert pair.session.pending.answer(12345, m.Pong) is None


def test_an_unawaited_error_is_raised_once():
    pair = Pair()
    pair.acquire("FR")
    pair.send(m.Error(code="wrong_step", text="step 3", fatal=False, about="pass"))
    with pytest.raises(
        Refused, match="pass was refused: wrong_step: step 3; use the step of the newest state"
    ):
        pair.session.next_tick("FR", 1, -1)
    assert pair.session.next_tick("FR", 1, -1) is None


def test_the_first_reason_for_the_end_is_kept():
    pair = Pair()
    pair.send(m.Error(code="shutting_down", text="maintenance", fatal=True))
    pair.session.receive_eof()
    with pytest.raises(Rejected, match="maintenance"):
        pair.session.check()


def test_the_text_of_every_code_contains_its_advice():
    for code in ErrorCode:
        error = m.Error(code=code.value, text="t", fatal=CODES[code].fatal)
        assert CODES[code].advice in str(client_errors.Refused(error))
    later = m.Error(code="code_of_a_later_version", text="t", fatal=False)
    assert str(client_errors.Refused(later)) == "a message was refused: code_of_a_later_version: t"


def test_a_remedy_in_the_text_of_an_error_is_not_followed_by_the_advice_of_its_code():
    text = "FR is held by lead; wait, or take it over as an operator"
    error = m.Error(code="leased", text=text, fatal=False, about="acquire")
    assert str(client_errors.Refused(error)) == f"acquire was refused: leased: {text}"
    fatal = m.Error(code="unauthorized", text="the token has expired; connect with a valid one", fatal=True)
    assert str(Rejected(fatal)).endswith("unauthorized: the token has expired; connect with a valid one")


def test_an_unknown_host_is_explained_as_such():
    error = socket.gaierror(socket.EAI_NONAME, "Name or service not known")
    text = "no connection to nohost:7411: Name or service not known; check the host"
    assert str(no_connection("nohost:7411", error)) == text


def test_absent_fields_and_robots_of_a_tick_are_explained():
    tick = Tick("FR", state(entries=(m.Entry(robot="FR", tick=0, time=0.0, setpoint=(1.0,)),)))
    assert tick.setpoint == (1.0,)
    with pytest.raises(BadArgument, match="q of FR was not subscribed"):
        _ = tick.q
    with pytest.raises(BadArgument, match="no robot GR in the state; it holds FR"):
        tick.entry("GR")


def test_invalid_arguments_are_named():
    with pytest.raises(BadArgument, match=r"^speed: "):
        build(m.Acquire, robot="FR", speed=2.0)
    with pytest.raises(BadArgument, match=r"^every: "):
        build(m.Subscribe, every=-1)


def test_a_message_beyond_the_servers_limit_is_not_sent():
    pair = Pair()
    pair.acquire("FR")
    with pytest.raises(BadArgument, match="at most 65536"):
        pair.session.command("FR", 1, 0, [0.0] * 10_000)
    pair.forward(pair.session.command("FR", 1, 0, [0.0])[1])
    assert len(pair.session.pending.verdicts("FR")) == 1


def test_the_docstring_lists_all_exceptions():
    classes = [c for c in vars(client_errors).values() if isinstance(c, type) and issubclass(c, Exception)]
    assert {c.__name__ for c in classes if c.__name__ not in client_errors.__doc__} == set()
    assert all(issubclass(c, client_errors.ClientError) for c in classes)


def test_a_delayed_signal_is_sent_although_the_next_command_is_invalid():
    pair = Pair()
    fence = pair.acquire("FR").fence
    assert pair.session.signal("zoom", 1.0, more=True) == b""
    with pytest.raises(BadArgument):
        pair.session.command("FR", fence, 0, [object()])
    (signal,) = pair.receive(pair.session.delayed())
    assert (signal.type, signal.name) == ("signal", "zoom")


@pytest.mark.parametrize("value", [10**400, [0.0, 10**400]], ids=["scalar", "vector"])
def test_a_signal_beyond_the_range_of_floats_is_explained(value):
    with pytest.raises(BadArgument, match="signal zoom: expected a number or numbers"):
        Pair().session.signal("zoom", value)
