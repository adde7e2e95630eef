"""Servers of other kinds: with TLS and tokens, with a link that is not ready, with two versions."""

import asyncio
import itertools
import re
import shlex
import sys
from functools import partial

import pytest

from armgate.conformance.case import Outcome, select_cases
from armgate.conformance.command_log import CommandLog
from armgate.conformance.connection import Connection
from armgate.conformance.runner import Runner
from armgate.conformance.target import Target, query_server
from armgate.conformance.wire_log import WireLog
from armgate.daemon.auth import tokens
from armgate.daemon.auth.keys import Keys
from armgate.daemon.auth.tls import server_context
from conformance.conftest import CONFIGS, another, serving
from support.certificates import Authority
from support.clients import run
from support.ports import free_ports
from support.robot_servers import RobotServer
from support.version2 import BOTH

ROLES = {"operator": None, "controller": None, "observer": None, "elsewhere": ("B",)}


def made(robots):
    """Return the secret of a token of each role, and the server's store of these tokens."""
    found = {
        name: tokens.make(name, "controller" if name == "elsewhere" else name, own)
        for name, own in robots.items()
    }
    return {name: one.secret for name, one in found.items()}, tokens.Tokens([o.token for o in found.values()])


class Mute(asyncio.Transport):
    """Transport that discards bytes."""

    def write(self, data):
        pass


async def test_a_server_with_tls_client_certificates_and_tokens(tmp_path):
    authority = Authority(tmp_path)
    secrets, kept = made(ROLES)
    keys = Keys(server_context(*authority.issue("server", "127.0.0.1"), authority.file), kept)
    certificate, key = authority.issue("kit")
    file = tmp_path / "tokens"
    file.write_text("# for the kit\n" + "".join(f"{role} {secret}\n" for role, secret in secrets.items()))
    file.chmod(0o600)
    only = ("--only", "SEC", "--only", "LEA-8", "--only", "CON-3", "--only", "FRM-2/merged")
    async with serving("conformance.yaml", keys=keys) as port:
        status, out, err = await run(
            "conformance", f"127.0.0.1:{port}", *only, "--token-file", file, "--tls-ca", authority.file,
            "--tls-cert", certificate, "--tls-key", key,
        )  # fmt: skip
    assert (status, err) == (0, ""), out
    passed = set(re.findall(r"^PASS +PASS +(\S+)", out, re.MULTILINE))
    assert {"SEC-2/none", "SEC-3/above", "SEC-5/robots", "SEC-10/plain"} <= passed
    assert "the server has tokens" in out


@pytest.mark.parametrize(
    ("unlimited", "outcome"), [(True, Outcome.PASS), (False, Outcome.FAIL)], ids=["unlimited", "locked"]
)
async def test_wrong_tokens_must_not_lock_out_a_right_one(unlimited, outcome, monkeypatch):
    secrets, kept = made({"operator": None})
    keys = Keys(None, kept)
    if not unlimited:
        guesses = itertools.count()
        find = tokens.Tokens.find
        monkeypatch.setattr(
            tokens.Tokens, "find", lambda self, secret: find(self, secret) if next(guesses) < 40 else None
        )
    async with serving("conformance.yaml", keys=keys) as port:
        another_one = partial(another, "conformance.yaml", keys=keys)
        target = Target("127.0.0.1", port, secrets, start_another=another_one)
        runner = Runner(target, await query_server(target, None, ()))
        (result,) = [r async for r in runner.run(select_cases(["SEC-14/guesses"]))]
    assert result.session is outcome, result.findings


FAR_ARM = """
armgate: 1
robots:
  R:
    urdf: {robots}/kr16.urdf
    base: {{xyz: [0, -10, 0]}}
    start: [0 deg, -90 deg, 90 deg, 0 deg, 45 deg, 0 deg]
    period: 0.012
    lag_window: 50 ms
    ignore_pairs: [[link_3, link_5]]
    link: {{kind: rsi, ethernet: {rsi}/axis-correction.xml, krc: 127.0.0.1, listen: "127.0.0.1:{port}"}}
"""


@pytest.mark.slow
async def test_a_robot_whose_link_is_not_ready(tmp_path):
    """Check that without a KRC a client can acquire the robot, but each of its commands is refused."""
    files = [CONFIGS / "conformance.yaml", tmp_path / "far.yaml"]
    (own,) = free_ports(1)
    files[1].write_text(FAR_ARM.format(robots=CONFIGS / "robots", rsi=CONFIGS / "rsi", port=own))
    async with RobotServer.running(*files, socket=tmp_path / "robots") as robots:
        start = [
            sys.executable,
            "-m",
            "armgate.apps",
            "serve",
            *files,
            "--port",
            0,
            "--robot-server",
            robots.socket,
        ]
        status, out, err = await run(
            "conformance", "--start", shlex.join(map(str, start)), "--only", "CMD-11"
        )
    assert (status, err) == (0, ""), out
    assert out.splitlines()[-1] == "1 cases, 1 passed, 0 failed, 0 skipped"


async def test_wire_logs_contain_no_token():
    log = WireLog()
    client = Connection("w", log, CommandLog(), 1.0)
    client.connection_made(Mute())
    client.send({"type": "hello", "name": "n", "token": "armgate_secret"})
    (_, line) = log.lines()
    assert "armgate_secret" not in line
    assert b"armgate_secret".hex() not in line.replace(" ", "")


async def test_a_server_with_two_versions():
    async with serving("conformance.yaml", dialects=BOTH) as port:
        target = Target("127.0.0.1", port)
        server = await query_server(target, None, ())
        runner = Runner(target, server)
        results = [r async for r in runner.run(select_cases(["VER", "EVO-8", "CMD-20", "STA-10", "SIG-1"]))]
    assert [(r.case.id, r.findings) for r in results if r.outcome is not Outcome.PASS] == []
