"""Access of clients: tokens, their file, failed logins, and their log."""

import hashlib
import io
import json
import os
import socket
from datetime import UTC, datetime, timedelta

import pytest

from armgate.daemon.auth import tokens as t
from armgate.daemon.auth.access import Access
from armgate.daemon.auth.address import origin
from armgate.daemon.auth.failure_log import FailureLog
from armgate.daemon.auth.unix_socket import UnixSocket, UnixSocketError, uids
from armgate.daemon.sessions.connection_limits import Slot
from armgate.links.log import Log
from armgate.protocol import RemoteProtocolError
from armgate.protocol import messages as m
from armgate.world.token_bucket import TokenBucket

HERE = "192.0.2.1"
USERS = {1000: "operator", 1001: "observer"}


class LoginBench:
    """Access control with three tokens and a log."""

    def __init__(self, in_all=100.0, per_origin=3.0):
        self.made = {
            "eye": t.make("eye", "observer", None),
            "lab": t.make("lab", "controller", ["FR"]),
            "boss": t.make("boss", "operator", None),
        }
        self.stream = io.StringIO()
        self.log = Log(self.stream)
        known = t.Tokens([made.token for made in self.made.values()])
        self.access = Access(known, FailureLog(in_all, per_origin, 0.0), self.log, USERS)

    def enter(self, name, role="controller", origin=HERE, now=0.0, uid=None):
        """Log in with the token of this name, or with a text that is not a token."""
        secret = self.made[name].secret if name in self.made else name
        token = {} if secret is None else {"token": secret}
        hello = m.Hello(versions=(1,), name="x", role=role, **token)
        return self.access.admit(hello, Slot(origin, uid), now)

    def refusal(self, *args, **more):
        with pytest.raises(RemoteProtocolError) as caught:
            self.enter(*args, **more)
        assert (caught.value.code, caught.value.fatal) == ("unauthorized", True)
        return caught.value.text

    def lines(self):
        self.log.close()
        return [json.loads(line) for line in self.stream.getvalue().splitlines()]


# --- what a token allows ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "allowed"),
    [
        ("eye", {"observer"}),
        ("lab", {"observer", "controller"}),
        ("boss", {"observer", "controller", "operator"}),
    ],
)
def test_a_token_allows_its_role_and_less(name, allowed):
    bench = LoginBench(per_origin=100.0)
    for role in ("observer", "controller", "operator"):
        if role in allowed:
            assert bench.enter(name, role).role == role
        else:
            bench.refusal(name, role)


def test_a_client_may_command_the_robots_of_its_token():
    bench = LoginBench()
    assert bench.enter("lab").robots == {"FR"}
    assert bench.enter("boss", "operator").robots is None


def test_reloaded_tokens_replace_the_earlier_ones():
    bench = LoginBench(per_origin=100.0)
    bench.access.replace(t.Tokens([bench.made["lab"].token]))
    assert bench.enter("lab").token == bench.made["lab"].token
    bench.refusal("eye", "observer")


def test_the_answer_does_not_reveal_which_check_failed():
    bench = LoginBench(per_origin=100.0)
    right = bench.made["eye"].secret
    texts = {
        bench.refusal(None),
        bench.refusal("wrong"),
        bench.refusal(right[:-1]),
        bench.refusal("eye", "operator"),
        bench.refusal(bench.made["eye"].token.sha256),
    }
    assert len(texts) == 1
    assert "armgate token" in texts.pop()


def test_the_log_names_the_failed_token_and_no_secret():
    bench = LoginBench(per_origin=100.0)
    for name, role in (("lab", "operator"), ("guess-1234", "observer"), (None, "observer")):
        bench.refusal(name, role)
    lines = bench.lines()
    assert [(line["why"], line["token"]) for line in lines] == [
        ("role", "lab"), ("unknown token", None), ("no token", None),
    ]  # fmt: skip
    text = bench.stream.getvalue()
    assert "guess" not in text
    assert all(made.secret not in text and made.token.sha256 not in text for made in bench.made.values())


def test_every_token_is_compared_in_constant_time(monkeypatch):
    bench, compared = LoginBench(), []
    real = t.hmac.compare_digest
    monkeypatch.setattr(t.hmac, "compare_digest", lambda a, b: compared.append((a, b)) or real(a, b))
    bench.enter("eye", "observer")
    assert len(compared) == len(bench.made)


# --- users of this machine --------------------------------------------------------------------------------


def test_a_user_has_the_role_that_the_configuration_gives():
    bench = LoginBench(per_origin=100.0)
    assert bench.enter(None, "operator", uid=1000).role == "operator"
    assert bench.enter(None, "observer", uid=1001).role == "observer"
    assert "observer at most" in bench.refusal(None, "controller", uid=1001)
    assert "user 1002 is not listed" in bench.refusal(None, "observer", uid=1002)


def test_a_user_may_present_a_token_instead():
    bench = LoginBench(per_origin=100.0)
    assert bench.enter("lab", "controller", uid=1002).token.name == "lab"
    bench.refusal("wrong", "observer", uid=1000)


def test_user_names_are_resolved_on_this_machine():
    assert uids({"root": "operator", "4711": "observer"}) == {0: "operator", 4711: "observer"}
    with pytest.raises(UnixSocketError, match="no user 'missing-user'"):
        uids({"missing-user": "observer"})


def test_the_socket_replaces_a_socket_left_behind_and_no_other_file(tmp_path):
    path = tmp_path / "cell.sock"
    left = socket.socket(socket.AF_UNIX)
    left.bind(str(path))
    left.close()
    served = UnixSocket(path)
    with pytest.raises(UnixSocketError, match="another daemon listens"):
        UnixSocket(path)
    served.close()
    assert not path.exists()
    path.write_text("something")
    with pytest.raises(UnixSocketError, match="is not a socket"):
        UnixSocket(path)
    assert path.read_text() == "something"


def test_the_socket_has_its_mode_from_the_beginning(tmp_path, monkeypatch):
    monkeypatch.setattr(
        t.Path, "chmod", lambda *_: pytest.fail("a symbolic link may have replaced the socket by then")
    )
    before = os.umask(0o077)
    try:
        served = UnixSocket(tmp_path / "cell.sock")
        assert os.umask(0o077) == 0o077
    finally:
        os.umask(before)
    assert served.path.stat().st_mode & 0o777 == 0o666
    served.close()


@pytest.mark.parametrize(("mode", "refused"), [(0o755, False), (0o775, True), (0o757, True), (0o1777, False)])
def test_the_folder_of_the_socket_must_not_be_writable_by_other_users(tmp_path, mode, refused):
    folder = tmp_path / "run"
    folder.mkdir()
    folder.chmod(mode)
    if refused:
        with pytest.raises(UnixSocketError, match="other users may write"):
            UnixSocket(folder / "cell.sock")
        assert not [*folder.iterdir()]
    else:
        UnixSocket(folder / "cell.sock").close()


def test_a_folder_of_another_user_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(t.os, "geteuid", lambda: 4711)
    if tmp_path.stat().st_uid == 0:
        os.chown(tmp_path, 4712, -1)
    with pytest.raises(UnixSocketError, match="other users may write"):
        UnixSocket(tmp_path / "cell.sock")


def test_a_missing_folder_is_named(tmp_path):
    with pytest.raises(UnixSocketError, match=r"none: No such file or directory; expected a folder"):
        UnixSocket(tmp_path / "none" / "cell.sock")


def test_a_socket_that_was_replaced_by_a_file_can_be_closed(tmp_path):
    path = tmp_path / "cell.sock"
    served = UnixSocket(path)
    path.unlink()
    path.write_text("something")
    served.close()
    assert path.read_text() == "something"
    path.unlink()
    UnixSocket(path).close()  # the lock is free


# --- failures ---------------------------------------------------------------------------------------------


def test_a_valid_token_is_accepted_after_any_number_of_failures_at_its_address():
    bench = LoginBench(in_all=3.0, per_origin=3.0)
    for _ in range(500):
        bench.refusal("wrong")
    assert bench.enter("lab").role == "controller"
    assert bench.enter("boss", "operator").role == "operator"
    assert bench.enter("eye", "observer", origin="192.0.2.2").role == "observer"


def test_failed_logins_are_logged_up_to_a_bound_per_address_and_in_total():
    bench = LoginBench(in_all=5.0, per_origin=3.0)
    for address in ("a", "b", "c"):
        for _ in range(10):
            bench.refusal("wrong", origin=address)
    bench.refusal("wrong", origin="a", now=60.0)
    lines = bench.lines()
    assert [line["origin"] for line in lines] == ["a", "a", "a", "b", "b", "a"]
    assert lines[-1]["unlogged"] == 18


def test_a_bounded_number_of_addresses_is_remembered():
    attempts = FailureLog(1e9, 1.0, 0.0)
    for number in range(5000):
        attempts.failed(f"a{number}", 0.0)
    assert len(attempts._failing) == 1024


def test_a_bucket_refills_up_to_its_burst():
    bucket = TokenBucket(rate=2.0, burst=3.0, now=0.0)
    assert [bucket.take(0.0) for _ in range(4)] == [True, True, True, False]
    assert bucket.wait(0.0) == pytest.approx(0.5)
    assert [bucket.take(0.5), bucket.take(0.5)] == [True, False]
    assert [bucket.take(100.0) for _ in range(4)] == [True, True, True, False]
    bucket.spend(2)
    assert bucket.wait(100.0) == pytest.approx(1.5)


@pytest.mark.parametrize(
    ("host", "counted"),
    [
        ("192.0.2.7", "192.0.2.7"),
        ("::ffff:192.0.2.7", "192.0.2.7"),
        ("2001:db8:1:2:3::4", "2001:db8:1:2::/64"),
        ("fe80::1%eth0", "fe80::/64"),
        ("?", "?"),
    ],
)
def test_origins_of_addresses(host, counted):
    assert origin(host) == counted


# --- the file ---------------------------------------------------------------------------------------------


def test_a_written_token_is_read_back_and_its_secret_is_not_stored(tmp_path):
    file = tmp_path / "tokens"
    made = [t.make("a", "controller", ["FR", "GR"]), t.make("b", "observer", None)]
    for one in made:
        t.append(file, one.token)
    assert file.stat().st_mode & 0o777 == 0o600
    assert [*t.read(file)] == [one.token for one in made]
    assert all(one.secret not in file.read_text() for one in made)
    assert t.read(file).find(made[1].secret) == made[1].token
    assert t.read(file).find(made[1].secret + "x") is None
    assert t.read(file).find(None) is None


def test_deleting_a_line_revokes_its_token(tmp_path):
    file = tmp_path / "tokens"
    made = [t.make(name, "observer", None) for name in "ab"]
    for one in made:
        t.append(file, one.token)
    file.write_text(file.read_text().splitlines()[1])
    assert t.read(file).find(made[0].secret) is None
    t.append(file, made[0].token)
    assert [token.name for token in t.read(file)] == ["b", "a"]


def test_secrets_are_long_and_never_the_same():
    secrets = {t.make("a", "observer", None).secret for _ in range(100)}
    assert len(secrets) == 100
    assert all(secret.startswith("armgate_") and len(secret) == 8 + 43 for secret in secrets)


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("{}", "name: Field required"),
        ("not json", "Invalid JSON"),
        ('{"name": "a", "role": "god", "robots": null, "sha256": "%s"}' % ("0" * 64), "role"),
        ('{"name": "a", "role": "observer", "robots": [], "sha256": "%s"}' % ("0" * 64), "robots"),
        ('{"name": "a", "role": "observer", "sha256": "0"}', "sha256"),
        ('{"name": "a", "role": "observer", "sha256": "%s", "pasted": 1}' % ("0" * 64), "Extra inputs"),
    ],
)
def test_an_invalid_line_is_named(tmp_path, line, told):
    file = tmp_path / "tokens"
    file.write_text("\n" + line + "\n")
    file.chmod(0o600)
    with pytest.raises(t.TokenError, match=r"tokens:2: .*armgate token") as caught:
        t.read(file)
    assert told in str(caught.value)
    assert "pasted" not in str(caught.value)


def test_a_file_that_other_users_may_write_is_refused(tmp_path):
    file = tmp_path / "tokens"
    t.append(file, t.make("a", "observer", None).token)
    file.chmod(0o620)
    with pytest.raises(t.TokenError, match="chmod 600"):
        t.read(file)


def test_a_missing_file_and_a_name_used_twice_are_named(tmp_path):
    file = tmp_path / "tokens"
    with pytest.raises(t.TokenError, match=r"No such file.*armgate token"):
        t.read(file)
    t.append(file, t.make("a", "observer", None).token)
    with pytest.raises(t.TokenError, match="two tokens named a"):
        t.append(file, t.make("a", "observer", None).token)


def test_a_file_of_another_user_is_refused(tmp_path, monkeypatch):
    file = tmp_path / "tokens"
    t.append(file, t.make("a", "observer", None).token)
    monkeypatch.setattr(t.os, "geteuid", lambda: 4711)
    if file.stat().st_uid != 0:
        with pytest.raises(t.TokenError, match="belongs to user"):
            t.read(file)
        return
    os.chown(file, 4712, -1)
    with pytest.raises(t.TokenError, match="belongs to user 4712"):
        t.read(file)


# --- expiry, rotation, certificates -----------------------------------------------------------------------


def later(seconds):
    return datetime.fromtimestamp(seconds, UTC)


def test_an_expired_token_is_refused():
    made = t.make("lab", "controller", None, later(1000.0))
    bench = LoginBench()
    wall = iter((999.0, 1000.0))
    access = Access(t.Tokens([made.token]), FailureLog(9, 9, 0.0), bench.log, wall=wall.__next__)
    hello = m.Hello(versions=(1,), name="x", token=made.secret)
    assert access.admit(hello, Slot(HERE), 0.0).token == made.token
    with pytest.raises(RemoteProtocolError, match="requires a token"):
        access.admit(hello, Slot(HERE), 0.0)
    assert bench.lines()[-1]["why"] == "expired"


def test_a_certificate_is_bound_to_a_role():
    bound = t.Token(name="alice", role="operator", certificate=hashlib.sha256(b"der").hexdigest())
    bench = LoginBench()
    access = Access(t.Tokens([bound, bench.made["lab"].token]), FailureLog(9, 9, 0.0), bench.log)
    hello = m.Hello(versions=(1,), name="x", role="operator")
    assert access.admit(hello, Slot(HERE), 0.0, b"der").token == bound
    for certificate in (b"other", None):
        with pytest.raises(RemoteProtocolError):
            access.admit(hello, Slot(HERE), 0.0, certificate)
    secret = m.Hello(versions=(1,), name="x", token=bench.made["lab"].secret)
    assert access.admit(secret, Slot(HERE), 0.0, b"der").token.name == "lab"


def test_a_line_has_either_a_secret_or_a_certificate():
    for more in ({}, {"sha256": "0" * 64, "certificate": "0" * 64}):
        with pytest.raises(ValueError, match="either sha256 or certificate"):
            t.Token(name="a", role="observer", **more)


def test_a_rotated_token_has_a_new_secret_and_the_old_one_until_the_overlap_ends(tmp_path):
    file = tmp_path / "tokens"
    first, other = t.make("a", "controller", ["FR"]), t.make("b", "observer", None)
    for one in (first, other):
        t.append(file, one.token)
    second = t.rotate(file, "a", later(1000.0))
    known = t.read(file)
    assert known.find(first.secret).expires == later(1000.0)
    assert known.find(first.secret).grant == first.token
    assert known.find(second.secret) == second.token
    assert (second.token.role, second.token.robots, second.token.expires) == ("controller", ("FR",), None)
    third = t.rotate(file, "a", None)
    known = t.read(file)
    assert known.find(first.secret) is known.find(second.secret) is None
    assert known.find(third.secret) == third.token
    assert known.find(other.secret) == other.token
    assert file.stat().st_mode & 0o777 == 0o600
    assert [path.name for path in tmp_path.iterdir()] == ["tokens"]
    with pytest.raises(t.TokenError, match="no secret of c; expected one of b, a"):
        t.rotate(file, "c", None)


def soon(hours):
    return datetime.now(UTC).replace(microsecond=0) + timedelta(hours=hours)


def test_rotation_does_not_extend_the_old_secret(tmp_path):
    file = tmp_path / "tokens"
    first = t.make("a", "controller", None, expires=soon(1))
    t.append(file, first.token)
    second = t.rotate(file, "a", soon(24))
    known = t.read(file)
    assert known.find(first.secret).expires == first.token.expires
    assert known.find(second.secret).expires == first.token.expires


@pytest.mark.parametrize("overlap", [None, 24])
def test_an_expired_token_is_not_rotated(tmp_path, overlap):
    file = tmp_path / "tokens"
    t.append(file, t.make("a", "controller", None, expires=soon(-1)).token)
    before = file.read_text()
    with pytest.raises(t.TokenError, match="a has expired; delete its line"):
        t.rotate(file, "a", overlap and soon(overlap))
    assert file.read_text() == before


def lines_of(*tokens):
    return "".join(token.model_dump_json(exclude_none=True) + "\n" for token in tokens)


FIRST = t.make("a", "observer", ["FR"], soon(1)).token


@pytest.mark.parametrize(
    "more",
    [
        {"role": "operator"},
        {"robots": None},
        {"robots": ("FR", "GR")},
        {"sha256": None, "certificate": "1" * 64},
    ],
)
def test_two_lines_of_one_name_must_have_the_same_rights_and_secrets(tmp_path, more):
    file = tmp_path / "tokens"
    file.touch(0o600)
    second = FIRST.model_copy(update={"sha256": "0" * 64, "expires": None})
    file.write_text(lines_of(FIRST, second))
    assert len([*t.read(file)]) == 2
    file.write_text(lines_of(FIRST, second.model_copy(update=more)))
    with pytest.raises(t.TokenError, match="two tokens named a"):
        t.read(file)


@pytest.mark.parametrize("proof", [{"sha256": "0" * 64}, {"sha256": None, "certificate": "0" * 64}])
def test_two_names_must_not_share_a_secret_or_certificate(tmp_path, proof):
    file = tmp_path / "tokens"
    file.touch(0o600)
    file.write_text(lines_of(*(FIRST.model_copy(update={"name": name} | proof) for name in "ab")))
    with pytest.raises(t.TokenError, match="the same secret or certificate for a and b") as caught:
        t.read(file)
    assert "000" not in str(caught.value)


@pytest.mark.parametrize("name", ["/dev/zero", "/dev/null", "pipe"])
def test_a_token_file_must_be_a_regular_file(tmp_path, name):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(t.TokenError, match="not a regular file"):
        t.append(tmp_path / name, t.make("a", "observer", None).token)
    assert not (tmp_path / name).is_file()


def test_a_symbolic_link_to_a_token_file_stays_a_link(tmp_path):
    file, link = tmp_path / "tokens", tmp_path / "link"
    link.symlink_to(file)
    t.append(link, t.make("a", "observer", None).token)
    t.append(link, t.make("b", "observer", None).token)
    assert link.is_symlink()
    assert [token.name for token in t.read(file)] == ["a", "b"]
