"""A daemon with TLS and tokens: both forms of the SDK, the command line, and clients that are refused."""

import asyncio
import contextlib
import json
import os
import signal
import socket
import stat

import pytest
import pytest_asyncio

from armgate.client import (
    BadArgument,
    ConnectionLost,
    Refused,
    Rejected,
    aio,
    blocking,
    read_token,
    tls_context,
)
from armgate.client.security import check_token
from armgate.protocol import messages as m
from support.cells import arms_yaml
from support.certificates import Authority
from support.clients import PATIENCE, Process, Raw, launch, run

pytestmark = pytest.mark.asyncio(loop_scope="module")

LOGINS = "login_failures: 1000, login_failures_per_address: 1000"


class Site:
    """A daemon, its CA and its tokens."""

    def __init__(self, folder, daemon, authority, tokens):
        self.folder, self.daemon, self.authority, self.tokens = folder, daemon, authority, tokens
        self.address = f"127.0.0.1:{daemon.port}"
        self.other = Authority(folder, "stranger")


async def token(file, *arguments):
    """Return the secret that `armgate token` prints, and its report."""
    status, out, err = await run("token", "--file", file, *arguments)
    assert status == 0, err
    return out.strip(), err


@contextlib.asynccontextmanager
async def site(folder, **tls):
    authority = Authority(folder)
    certificate, key = authority.issue("cell", "127.0.0.1")
    file = folder / "tokens"
    tokens = {
        "eye": (await token(file, "--role", "observer", "--name", "eye"))[0],
        "lab": (await token(file, "--role", "controller", "--name", "lab", "--robots", "A"))[0],
        "boss": (await token(file, "--role", "operator", "--name", "boss"))[0],
    }
    files = ", ".join(
        f"{k}: {v}" for k, v in ({"certificate": certificate.name, "key": key.name} | tls).items()
    )
    config = folder / "arms.yaml"
    server = f"{{host: 0.0.0.0, tls: {{{files}}}, tokens: tokens, handshake_timeout: 1.0, {LOGINS}}}"
    config.write_text(arms_yaml(max_age_ticks=1000, server=server))
    async with Process.serving(config, host="0.0.0.0") as daemon:
        yield Site(folder, daemon, authority, tokens)
        daemon.signal()
        status, log = await daemon.end()
        assert status == 0
        text = json.dumps(log)
        assert all(secret not in text for secret in tokens.values())
        assert "guessed" not in text


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def secured(tmp_path_factory):
    async with site(tmp_path_factory.mktemp("secured")) as made:
        yield made


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def mutual(tmp_path_factory):
    """Daemon with TLS and tokens that also requires certificates of clients."""
    async with site(tmp_path_factory.mktemp("mutual"), client_ca="ca.pem") as made:
        yield made


@pytest.fixture(params=["aio", "blocking"])
def connect(request):
    """Return a coroutine around ``connect``, once of the asyncio SDK and once of the blocking SDK."""

    async def call(address, *args, **more):
        if request.param == "aio":
            return await aio.connect(address, *args, **more)
        return await asyncio.to_thread(blocking.connect, address, *args, **more)

    return call


async def done(result):
    return await result if asyncio.iscoroutine(result) else result


# --- TLS --------------------------------------------------------------------------------------------------


@pytest.mark.daily(1)
async def test_a_controller_over_tls(secured, connect):
    cell = await connect(secured.address, "lab", token=secured.tokens["lab"], tls=secured.authority.file)
    assert cell.welcome.role == "controller"
    assert len(await done(cell.urdf("A"))) > 1000
    robot = await done(cell.acquire("A"))
    if isinstance(cell, aio.Cell):
        ticks = robot.ticks()
        for _ in range(20):
            await anext(ticks)
            verdict = await robot.send([0.0005, 0.0, 0.0])
        await robot.release()
        await cell.close()
    else:
        verdict = await asyncio.to_thread(drive, cell, robot)
    assert verdict.seq == 20


def drive(cell, robot):
    ticks = robot.ticks()
    for _ in range(20):
        next(ticks)
        verdict = robot.send([0.0005, 0.0, 0.0])
    robot.release()
    cell.close()
    return verdict


async def test_a_client_may_bring_its_own_tls_context(secured, connect):
    context = tls_context(secured.authority.file)
    cell = await connect(secured.address, "eye", "observer", secured.tokens["eye"], tls=context)
    await done(cell.close())


async def test_a_certificate_of_an_unknown_ca_is_not_trusted(secured, connect):
    with pytest.raises(ConnectionLost, match=r"no connection to .*; give the CA"):
        await connect(secured.address, "eye", token=secured.tokens["eye"], tls=secured.other.file)
    with pytest.raises(ConnectionLost, match="give the CA"):
        await connect(secured.address, "eye", token=secured.tokens["eye"], tls=True)


async def test_a_certificate_for_another_host_is_not_trusted(secured, connect):
    with pytest.raises(ConnectionLost, match="not valid for"):
        await connect(
            f"127.0.0.2:{secured.daemon.port}", "eye", token=secured.tokens["eye"], tls=secured.authority.file
        )


async def test_an_error_without_tls_suggests_tls(secured, connect):
    with pytest.raises(ConnectionLost, match="does it require TLS"):
        await connect(secured.address, "eye", token=secured.tokens["eye"])


@pytest.mark.daily(1)
async def test_tls_with_a_server_without_tls_is_reported(tmp_path, connect):
    config = tmp_path / "arms.yaml"
    config.write_text(arms_yaml())
    authority = Authority(tmp_path)
    async with Process.serving(config) as daemon:
        with pytest.raises(ConnectionLost, match="does the daemon use TLS"):
            await connect(f"127.0.0.1:{daemon.port}", "eye", tls=authority.file)


async def test_invalid_certificate_files_are_bad_arguments(secured, connect):
    with pytest.raises(BadArgument, match=r"none\.pem: No such file"):
        await connect(secured.address, "eye", tls=secured.folder / "none.pem")
    with pytest.raises(BadArgument, match=r"tokens: .*PEM"):
        await connect(secured.address, "eye", tls=secured.folder / "tokens")
    with pytest.raises(BadArgument, match="needs a certificate"):
        tls_context(secured.authority.file, key="a.key")


@pytest.mark.daily(1)
async def test_clients_without_a_required_certificate_are_refused(mutual, connect):
    own = mutual.authority.issue("client")
    good = tls_context(mutual.authority.file, *own)
    cell = await connect(mutual.address, "eye", "observer", mutual.tokens["eye"], tls=good)
    await done(cell.close())
    foreign = tls_context(mutual.authority.file, *mutual.other.issue("foreign"))
    for context in (foreign, tls_context(mutual.authority.file)):
        with pytest.raises(ConnectionLost):
            await connect(mutual.address, "eye", "observer", mutual.tokens["eye"], tls=context)


async def test_a_token_is_never_sent_over_a_network_without_tls():
    check_token("secret", None, ("127.0.0.1", 1))
    check_token("secret", None, ("::1", 1, 0, 0))
    check_token(None, None, ("192.0.2.1", 1))
    check_token("secret", tls_context(), ("192.0.2.1", 1))
    with pytest.raises(BadArgument, match=r"the network to 192\.0\.2\.1 unencrypted"):
        check_token("secret", None, ("192.0.2.1", 1))


@pytest.mark.daily(1)
async def test_half_open_tls_disturbs_no_other_client(secured, connect):
    silent = [await asyncio.open_connection("127.0.0.1", secured.daemon.port) for _ in range(20)]
    cell = await connect(
        secured.address, "eye", "observer", secured.tokens["eye"], tls=secured.authority.file
    )
    await done(cell.close())
    for reader, writer in silent:
        assert await asyncio.wait_for(reader.read(), PATIENCE) == b""
        writer.close()


@pytest.mark.parametrize(
    ("host", "purposes"),
    [("127.0.0.1", None), (None, ()), ("127.0.0.1", ("SERVER_AUTH",)), (None, ("EMAIL_PROTECTION",))],
    ids=["the server's", "no purpose", "for servers", "for mail"],
)
async def test_a_certificate_that_is_not_for_clients_is_refused(mutual, connect, host, purposes):
    own = mutual.authority.issue("other", host, purposes)
    context = tls_context(mutual.authority.file, *own)
    with pytest.raises(ConnectionLost, match=r"not for clients|certificate"):
        await connect(mutual.address, "boss", "operator", mutual.tokens["boss"], tls=context)


async def test_a_certificate_for_servers_and_clients_is_for_clients(mutual, connect):
    own = mutual.authority.issue("both", None, ("SERVER_AUTH", "CLIENT_AUTH"))
    context = tls_context(mutual.authority.file, *own)
    cell = await connect(mutual.address, "eye", "observer", mutual.tokens["eye"], tls=context)
    await done(cell.close())


@pytest.mark.slow
async def test_certificates_are_reloaded_at_sighup(tmp_path):
    authority = Authority(tmp_path)
    _, key = authority.issue("cell", "127.0.0.1")
    config = tmp_path / "arms.yaml"
    config.write_text(arms_yaml(server="{tls: {certificate: cell.pem, key: cell.key}}"))
    async with Process.serving(config) as daemon:
        address = f"127.0.0.1:{daemon.port}"
        first = await aio.connect(address, "first", "observer", tls=authority.file)
        good = key.read_bytes()
        key.write_text("nothing")
        kept = await reread(daemon, "certificates.kept")
        assert "cell.key" in kept["error"]
        await (await aio.connect(address, "kept", "observer", tls=authority.file)).close()
        key.write_bytes(good)
        newer = Authority(tmp_path, "newer")
        newer.issue("cell", "127.0.0.1")
        await reread(daemon, "certificates.read")
        await (await aio.connect(address, "new", "observer", tls=newer.file)).close()
        with pytest.raises(ConnectionLost):
            await aio.connect(address, "old", "observer", tls=authority.file)
        await first.ping()
        await first.close()


# --- tokens -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("given", "role"),
    [(None, "observer"), ("guessed", "observer"), ("lab", "operator"), ("eye", "controller")],
)
async def test_a_client_without_a_sufficient_token_is_refused(secured, connect, given, role):
    secret = secured.tokens.get(given, given)
    with pytest.raises(Rejected, match="armgate token") as caught:
        await connect(secured.address, "x", role, secret, tls=secured.authority.file)
    assert caught.value.code == "unauthorized"


async def test_a_token_is_for_the_robots_that_it_names(secured):
    context = tls_context(secured.authority.file)
    async with await aio.connect(
        secured.address, "lab", "controller", secured.tokens["lab"], tls=context
    ) as cell:
        with pytest.raises(Refused, match="does not allow B") as caught:
            await cell.acquire("B")
        assert caught.value.code == "forbidden"
        async with await cell.acquire("A") as robot:
            assert robot.held


async def test_an_operator_takes_over_and_resets(secured):
    context = tls_context(secured.authority.file)
    lab = await aio.connect(secured.address, "lab", "controller", secured.tokens["lab"], tls=context)
    boss = await aio.connect(secured.address, "boss", "operator", secured.tokens["boss"], tls=context)
    async with lab, boss:
        await lab.acquire("A")
        with pytest.raises(Refused, match="only an operator"):
            await lab.acquire("A", takeover=True)
        await boss.acquire("A", takeover=True)
        stopped = await lab.stop()
        with pytest.raises(Refused, match="not allowed as controller"):
            await lab.reset(stopped.stop)
        await boss.reset(stopped.stop)


@pytest.mark.slow
async def test_configured_tokens_are_required_on_loopback_too(tmp_path):
    secret, _ = await token(tmp_path / "tokens", "--role", "observer")
    config = tmp_path / "arms.yaml"
    config.write_text(arms_yaml(server="{tokens: tokens, login_failures_per_address: 2}"))
    async with Process.serving(config) as daemon:
        for role, given, code in (
            ("observer", {"token": secret}, None),
            ("operator", {}, "unauthorized"),
            ("operator", {"token": secret}, "unauthorized"),
            ("observer", {"token": secret}, None),
        ):
            raw = await Raw.open(daemon.port)
            raw.send(m.Hello(versions=(1,), name="x", role=role, **given))
            answer = await raw.get((m.Welcome, m.Error))
            assert getattr(answer, "code", None) == code


async def login(port, role, secret):
    """Return a connection, and the answer to its hello."""
    raw = await Raw.open(port)
    raw.send(m.Hello(versions=(1,), name="x", role=role, token=secret))
    return raw, await raw.get((m.Welcome, m.Error))


@pytest.mark.slow
async def test_no_client_can_lock_out_owners_of_tokens_at_its_address(tmp_path):
    """Silent connections, idle sessions up to their bound, and wrong tokens, all from one address."""
    config, secrets = tmp_path / "arms.yaml", {}
    for role in ("observer", "controller", "operator"):
        secrets[role], _ = await token(tmp_path / "tokens", "--role", role, "--name", role)
    config.write_text(arms_yaml(server="{tokens: tokens, connection_rate: 1000}"))
    async with Process.serving(config) as daemon:
        for _ in range(63):
            _, answer = await login(daemon.port, "observer", secrets["observer"])
        assert answer.code == "too_many"
        for _ in range(90):
            await Raw.open(daemon.port)
        for _ in range(40):
            raw, answer = await login(daemon.port, "operator", "armgate_wrong")
            assert answer.code == "unauthorized"
            await raw.close()
        for role in ("controller", "operator"):
            _, answer = await login(daemon.port, role, secrets[role])
            assert isinstance(answer, m.Welcome), answer
        _, answer = await login(daemon.port, "observer", secrets["observer"])
        assert answer.code == "too_many"


async def test_a_token_can_be_written_to_a_file_that_only_its_user_can_read(tmp_path):
    out = tmp_path / "mine"
    before = os.umask(0)
    try:
        secret, told = await token(tmp_path / "tokens", "--role", "observer", "--out", out)
    finally:
        os.umask(before)
    assert secret == ""
    assert stat.S_IMODE(out.stat().st_mode) == 0o600
    assert out.read_text().strip() not in told
    assert read_token(out).startswith("armgate_")
    status, _, err = await run(
        "token", "--role", "observer", "--name", "b", "--file", tmp_path / "tokens", "--out", out
    )
    assert status == 2
    assert "the file exists" in err
    assert "b" not in (json.loads(line)["name"] for line in (tmp_path / "tokens").read_text().splitlines())


async def test_a_token_keeps_its_secret_if_the_new_one_has_no_place(tmp_path):
    file = tmp_path / "tokens"
    await token(file, "--role", "observer", "--name", "eye")
    stored = file.read_text()
    for arguments in (("--rotate", "eye"), ("--role", "observer", "--name", "b")):
        status, out, err = await run("token", "--file", file, *arguments, "--out", tmp_path / "none" / "mine")
        assert (status, out) == (2, "")
        assert "there is no folder" in err
        assert file.read_text() == stored


# --- revoked tokens ---------------------------------------------------------------------------------------


async def reread(daemon, event):
    """Send SIGHUP to the daemon; return its next log line with this event."""
    daemon.signal(signal.SIGHUP)
    async with asyncio.timeout(PATIENCE):
        while (line := json.loads(await daemon.process.stderr.readline()))["event"] != event:
            pass
    return line


async def test_a_revoked_token_ends_its_sessions_and_no_others(tmp_path):
    file, config = tmp_path / "tokens", tmp_path / "arms.yaml"
    lab, _ = await token(file, "--role", "controller", "--name", "lab")
    eye, _ = await token(file, "--role", "observer", "--name", "eye")
    both = file.read_text().splitlines()
    config.write_text(arms_yaml(max_age_ticks=1000, server=f"{{tokens: tokens, {LOGINS}}}"))
    async with Process.serving(config) as daemon:
        address = f"127.0.0.1:{daemon.port}"
        gone = await aio.connect(address, "gone", token=lab)
        robot = await gone.acquire("A")
        await anext(robot.ticks())
        await robot.send([0.001, 0.0, 0.0])
        async with await aio.connect(address, "eye", "observer", token=eye) as stays:
            file.write_text("\n".join([*both, "armgate_pasted"]) + "\n")
            told = await reread(daemon, "tokens.kept")
            assert "tokens:3" in told["error"]
            assert "armgate_pasted" not in json.dumps(told)
            await gone.ping()

            new, _ = await token(file := tmp_path / "other", "--role", "controller", "--name", "new")
            (tmp_path / "tokens").write_text(both[1] + "\n" + file.read_text())
            assert (await reread(daemon, "tokens.read"))["names"] == ["eye", "new"]
            with pytest.raises(Rejected, match="revoked") as caught:
                await gone.ping()
            assert caught.value.code == "unauthorized"
            await stays.ping()
            async with await aio.connect(address, "new", token=new) as cell:
                await cell.acquire("A")  # the former lease has ended
            with pytest.raises(Rejected, match="armgate token"):
                await aio.connect(address, "gone", token=lab)
        await gone.close()
        daemon.signal()
        assert (await daemon.end())[0] == 0


@pytest.mark.slow
async def test_without_tokens_sighup_ends_the_daemon_in_order(tmp_path):
    config = tmp_path / "arms.yaml"
    config.write_text(arms_yaml())
    async with Process.serving(config) as daemon:
        daemon.signal(signal.SIGHUP)
        status, log = await daemon.end()
    assert status == 0
    assert "at_rest" in [line["event"] for line in log]


# --- the command line -------------------------------------------------------------------------------------


async def test_a_token_is_printed_once_and_stored_as_a_hash(tmp_path):
    file = tmp_path / "tokens"
    secret, said = await token(file, "--role", "controller", "--robots", "A, B", "--name", "lab")
    assert secret.startswith("armgate_")
    assert "lab" in said
    assert secret not in said
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    (line,) = file.read_text().splitlines()
    assert {**json.loads(line), "sha256": "…"} == {
        "name": "lab", "role": "controller", "robots": ["A", "B"], "sha256": "…",
    }  # fmt: skip
    assert secret not in line
    status, out, err = await run("token", "--role", "observer", "--name", "lab", "--file", file)
    assert (status, out) == (2, "")
    assert "two tokens named lab" in err
    status, out, err = await run("token", "--role", "observer", "--name", "two words", "--file", file)
    assert (status, out) == (2, "")
    assert "two words" in err


@pytest.mark.daily(1)
@pytest.mark.parametrize(
    ("server", "told"),
    [
        ("{host: 0.0.0.0, tokens: tokens}", "configure server.tls ("),
        ("{host: 0.0.0.0, tls: {certificate: cell.pem, key: cell.key}}", "configure server.tokens ("),
        ("{tls: {certificate: cell.pem, key: none.key}}", "none.key: No such file"),
        ("{tokens: none}", "none: No such file"),
        ("{tokens: ca.pem}", "ca.pem:1"),
    ],
)
async def test_the_missing_setting_for_listening_is_named(tmp_path, server, told):
    authority = Authority(tmp_path)
    authority.issue("cell", "127.0.0.1")
    await token(tmp_path / "tokens", "--role", "observer")
    authority.file.chmod(0o600)
    config = tmp_path / "arms.yaml"
    config.write_text(arms_yaml(server=server))
    status, out, err = await run("serve", config)
    assert (status, out) == (2, "")
    assert told in err, err
    assert "Traceback" not in err


async def lead(secured, *arguments, **environment):
    path = "configs/paths/inspection.csv"
    process = await launch(
        "lead", secured.address, "--path", path, *map(str, arguments),
        env={k: v for k, v in os.environ.items() if k != "ARMGATE_TOKEN"} | environment,
    )  # fmt: skip
    async with asyncio.timeout(PATIENCE):
        _, err = await process.communicate()
    return process.returncode, err.decode()


async def test_programs_take_tokens_from_a_file_or_the_environment(secured):
    ca = ("--ca", secured.authority.file)
    status, err = await lead(secured, *ca)
    assert status == 1
    assert "unauthorized" in err
    file = secured.folder / "mine"
    file.write_text(secured.tokens["lab"] + "\n")
    file.chmod(0o600)
    inside = "no robot 'GR'"  # the login succeeds; the path is for a robot of another cell
    status, err = await lead(secured, *ca, "--token-file", file)
    assert inside in err, err
    status, err = await lead(secured, *ca, ARMGATE_TOKEN=secured.tokens["lab"])
    assert inside in err, err


@pytest.mark.slow
async def test_programs_report_the_error_of_a_login(secured):
    empty = secured.folder / "empty"
    empty.write_text("")
    empty.chmod(0o600)
    open_ = secured.folder / "open"
    open_.write_text(secured.tokens["lab"] + "\n")
    open_.chmod(0o644)
    for arguments, told in (
        (("--token-file", empty), "one token"),
        (("--token-file", open_), f"(mode 0644); run: chmod 600 {open_}"),
        (("--token-file", secured.folder / "none"), "none: No such file"),
        (("--cert", "a.pem"), "--ca"),
        (("--ca", secured.folder / "none"), "none: No such file"),
    ):
        status, err = await lead(secured, *arguments)
        assert status == 2
        assert told in err


# --- expiry, rotation, certificates bound to a role -------------------------------------------------------


@pytest.mark.slow
async def test_a_session_ends_when_its_token_expires(tmp_path):
    file, config = tmp_path / "tokens", tmp_path / "arms.yaml"
    soon, _ = await token(file, "--role", "controller", "--name", "soon", "--days", 10 / 86400)
    lasting, _ = await token(file, "--role", "controller", "--name", "lasting")
    config.write_text(arms_yaml(server="{tokens: tokens}"))
    async with Process.serving(config) as daemon:
        short, answer = await login(daemon.port, "controller", soon)
        assert isinstance(answer, m.Welcome), answer
        long, _ = await login(daemon.port, "controller", lasting)
        error = (await short.rest())[-1]
        assert (error.code, error.fatal) == ("unauthorized", True)
        assert "has expired" in error.text
        long.send(m.Ping(time=1.0))
        await long.get(m.Pong)
        _, answer = await login(daemon.port, "controller", soon)
        assert answer.code == "unauthorized"


@pytest.mark.slow
async def test_a_rotated_token_keeps_its_sessions_while_the_old_secret_is_valid(tmp_path):
    file, config = tmp_path / "tokens", tmp_path / "arms.yaml"
    old, _ = await token(file, "--role", "controller", "--name", "lab")
    config.write_text(arms_yaml(server="{tokens: tokens}"))
    async with Process.serving(config) as daemon:
        session, _ = await login(daemon.port, "controller", old)
        new, told = await token(file, "--rotate", "lab", "--overlap", "1")
        assert "valid for 1 h at most" in told
        await reread(daemon, "tokens.read")
        session.send(m.Ping(time=1.0))
        await session.get(m.Pong)
        for secret in (old, new):
            _, answer = await login(daemon.port, "controller", secret)
            assert isinstance(answer, m.Welcome), answer
        await token(file, "--rotate", "lab")
        await reread(daemon, "tokens.read")
        assert (await session.rest())[-1].code == "unauthorized"


@pytest.mark.daily(1)
async def test_a_certificate_gives_a_role_without_a_secret(tmp_path, connect):
    authority = Authority(tmp_path)
    authority.issue("cell", "127.0.0.1")
    own, other = authority.issue("alice"), authority.issue("bob")
    await token(tmp_path / "tokens", "--role", "operator", "--name", "alice", "--certificate", own[0])
    config = tmp_path / "arms.yaml"
    tls = "{certificate: cell.pem, key: cell.key, client_ca: ca.pem}"
    config.write_text(arms_yaml(server=f"{{tls: {tls}, tokens: tokens}}"))
    async with Process.serving(config) as daemon:
        address = f"127.0.0.1:{daemon.port}"
        cell = await connect(address, "alice", "operator", tls=tls_context(authority.file, *own))
        assert cell.welcome.role == "operator"
        await done(cell.close())
        with pytest.raises(Rejected, match="armgate token"):
            await connect(address, "bob", "observer", tls=tls_context(authority.file, *other))


# --- users of this machine --------------------------------------------------------------------------------


@pytest.mark.daily(1)
@pytest.mark.parametrize(("role", "more"), [("controller", "operator"), ("observer", "controller")])
async def test_on_a_unix_socket_the_kernel_identifies_the_user_of_a_client(tmp_path, connect, role, more):
    config = tmp_path / "arms.yaml"
    config.write_text(arms_yaml(server=f"{{socket: {{path: cell.sock, users: {{{os.getuid()}: {role}}}}}}}"))
    address = f"unix:{tmp_path / 'cell.sock'}"
    async with Process.serving(config, "--require-login", host="unix") as daemon:
        cell = await connect(address, "me", role)
        assert cell.welcome.role == role
        assert len(await done(cell.urdf("A"))) > 1000
        await done(cell.close())
        with pytest.raises(Rejected, match=f"user {os.getuid()} may connect as {role} at most"):
            await connect(address, "me", more)
        with pytest.raises(BadArgument, match="does not use TLS"):
            await connect(address, "me", role, tls=True)
        daemon.signal()
        status, log = await daemon.end()
    assert status == 0
    assert not (tmp_path / "cell.sock").exists()
    (welcome,) = (line for line in log if line["event"] == "welcome")
    assert welcome["address"] == f"uid {os.getuid()}"
    with pytest.raises(ConnectionLost, match="is `armgate serve` running there"):
        await connect(address, "me", role)


@pytest.mark.daily(1)
@pytest.mark.parametrize("name", ["a", "\0a", "\0abc"])
async def test_the_name_of_a_clients_own_socket_has_no_effect(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    config = tmp_path / "arms.yaml"
    config.write_text(
        arms_yaml(server=f"{{socket: {{path: cell.sock, users: {{{os.getuid()}: observer}}}}}}")
    )
    async with Process.serving(config, host="unix") as daemon:
        with socket.socket(socket.AF_UNIX) as client:
            client.bind(name)
            client.connect("cell.sock")
            async with await aio.connect(f"unix:{tmp_path / 'cell.sock'}", "me", "observer") as cell:
                await cell.ping()
        daemon.signal()
        assert (await daemon.end())[0] == 0


@pytest.mark.slow
async def test_a_user_that_is_not_listed_needs_a_token(tmp_path):
    secret, _ = await token(tmp_path / "tokens", "--role", "operator")
    config = tmp_path / "arms.yaml"
    server = f"{{tokens: tokens, socket: {{path: cell.sock, users: {{{os.getuid() + 1}: operator}}}}}}"
    config.write_text(arms_yaml(server=server))
    address = f"unix:{tmp_path / 'cell.sock'}"
    async with Process.serving(config) as daemon:
        with pytest.raises(Rejected, match="is not listed"):
            await aio.connect(address, "me", "observer")
        async with await aio.connect(address, "me", "operator", secret) as cell:
            assert cell.welcome.role == "operator"
        with pytest.raises(Rejected):
            await aio.connect(f"127.0.0.1:{daemon.port}", "me", "observer")


async def test_a_service_refuses_to_start_without_login(tmp_path):
    config = tmp_path / "arms.yaml"
    config.write_text(arms_yaml())
    status, out, err = await run("serve", config, "--require-login")
    assert (status, out) == (2, "")
    assert "configure server.tokens or server.socket" in err


# --- other sessions ---------------------------------------------------------------------------------------


@pytest.mark.slow
async def test_an_operator_lists_sessions_and_ends_one_from_the_command_line(tmp_path):
    file, config = tmp_path / "tokens", tmp_path / "arms.yaml"
    lab, _ = await token(file, "--role", "controller", "--name", "lab")
    boss = tmp_path / "boss"
    await token(file, "--role", "operator", "--name", "alice", "--out", boss)
    config.write_text(arms_yaml(server="{tokens: tokens, lease_ttl: 60.0}"))
    async with Process.serving(config) as daemon:
        address = f"127.0.0.1:{daemon.port}"
        raw, welcome = await login(daemon.port, "controller", lab)
        await raw.acquire("A")
        status, out, err = await run("sessions", address, "--token-file", boss)
        assert (status, err) == (0, "")
        assert f"{welcome.session}  x  controller  token lab  127.0.0.1:" in out
        assert out.splitlines()[0].endswith("  A")
        kick = ("--kick", welcome.session, "--reason", "enough")
        status, out, err = await run("sessions", address, "--token-file", boss, *kick)
        assert (status, out, err) == (0, f"session {welcome.session} has ended\n", "")
        error = (await raw.rest())[-1]
        assert (error.code, error.text) == ("kicked", "sessions ended this session: enough")
        status, out, err = await run("sessions", address, "--token-file", boss, *kick)
        assert status == 1
        assert "unknown_session" in err
        mine = tmp_path / "lab"
        mine.write_text(lab)
        mine.chmod(0o600)
        status, out, err = await run("sessions", address, "--token-file", mine)
        assert status == 1
        assert "unauthorized" in err
