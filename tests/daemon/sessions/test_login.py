"""Identity of clients after their hello, and the end of sessions whose token is no longer valid."""

import io
from datetime import UTC, datetime, timedelta
from types import SimpleNamespace

import pytest

from armgate.cell.config import ServerConfig
from armgate.daemon.auth.keys import Keys
from armgate.daemon.auth.tokens import Tokens, make
from armgate.daemon.sessions.connection_limits import ConnectionLimits, Slot
from armgate.daemon.sessions.login import Login
from armgate.links.log import Log
from armgate.protocol import messages as m


class Session:
    """A session that keeps the reasons for which it was ended."""

    def __init__(self, uid=None):
        self.slot = Slot("192.0.2.1" if uid is None else f"uid {uid}", uid)
        self.number, self.address, self.certificate = 7, "192.0.2.1:4711", None
        self.capabilities = frozenset({"sessions"})
        self.greeted = True
        self.ended = []

    def expel(self, error):
        self.ended.append(error.text)


@pytest.fixture
def login_bench():
    """A login with one token, and a log."""
    made = make("lab", "controller", ("A",))
    log = Log(io.StringIO())

    def login(tokens=(made.token,), users=None):
        keys = Keys(tokens=None if tokens is None else Tokens(tokens), users=users or {})
        limits = ConnectionLimits(10, 10)
        return Login(ServerConfig(), keys, limits, lambda name, number: f"s{number}", ("A", "B"), log)

    yield SimpleNamespace(made=made, login=login)
    log.close()


def hello(secret=None, role="controller"):
    return m.Hello(versions=(1,), name="wave", role=role, token=secret)


def test_a_client_is_known_by_its_token(login_bench):
    session = Session()
    client = login_bench.login().admit(session, hello(login_bench.made.secret))
    assert (client.id, client.name, client.role, client.robots) == ("s7", "wave", "controller", {"A"})
    assert (client.identity, client.token, client.known_as) == ("token lab", "lab", "lab")
    assert (client.address, client.capabilities) == ("192.0.2.1:4711", {"sessions"})


def test_a_user_of_the_unix_socket_is_known_by_its_number_unless_it_gives_a_token(login_bench):
    login = login_bench.login(users={1000: "controller"})
    client = login.admit(Session(1000), hello())
    assert (client.identity, client.token, client.known_as) == ("uid 1000", None, "uid 1000")
    client = login.admit(Session(1000), hello(login_bench.made.secret))
    assert (client.token, client.known_as) == ("lab", "lab")


def test_without_tokens_only_the_name_of_a_client_is_known(login_bench):
    client = login_bench.login(tokens=None).admit(Session(), hello())
    assert (client.identity, client.token, client.known_as) == ("192.0.2.1", None, None)


def test_sessions_of_a_revoked_token_end_and_sessions_of_a_renewed_token_continue(login_bench):
    login, session = login_bench.login(), Session()
    login.admit(session, hello(login_bench.made.secret))
    later = login_bench.made.token.model_copy(update={"expires": datetime.now(UTC) + timedelta(days=1)})
    assert login.use_tokens(Tokens([later])) == {"names": ["lab"]}
    assert session.ended == []
    login.use_tokens(Tokens([]))
    assert ["revoked" in text for text in session.ended] == [True]


async def test_sessions_of_an_expired_token_end(login_bench):
    login, session, other = login_bench.login(), Session(), Session()
    for one in (session, other):
        login.admit(one, hello(login_bench.made.secret))
    login.closed(other)
    login.end_expired()
    assert session.ended == []
    past = login_bench.made.token.model_copy(update={"expires": datetime.now(UTC) - timedelta(seconds=1)})
    login.use_tokens(Tokens([past]))
    login.end_expired()
    login.end_expired()
    assert ["expired" in text for text in session.ended] == [True]
    assert other.ended == []
