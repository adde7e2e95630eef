"""Servers of other kinds: with TLS and tokens, with two versions."""

import asyncio
import re

from armgate.conformance.case import selected
from armgate.conformance.ledger import Ledger
from armgate.conformance.log import WireLog
from armgate.conformance.runner import Runner
from armgate.conformance.target import Target, ask
from armgate.conformance.verdicts import Outcome
from armgate.conformance.wire import Wire
from armgate.daemon import tokens
from armgate.daemon.access import Keys
from armgate.daemon.tls import server_context
from conformance.conftest import serving
from support.certificates import Authority
from support.clients import run
from support.version2 import BOTH

ROLES = {"operator": None, "controller": None, "observer": None, "elsewhere": ("B",)}


def made(robots):
    """A token of each kind, and what the server keeps of them."""
    found = {
        name: tokens.make(name, "controller" if name == "elsewhere" else name, own)
        for name, own in robots.items()
    }
    return {name: one.secret for name, one in found.items()}, tokens.Tokens([o.token for o in found.values()])


class Mute(asyncio.Transport):
    """Takes bytes and does nothing."""

    def write(self, data):
        pass


async def test_a_server_with_tls_and_tokens(tmp_path):
    authority = Authority(tmp_path)
    secrets, kept = made(ROLES)
    keys = Keys(server_context(*authority.issue("server", "127.0.0.1"), None), kept)
    file = tmp_path / "tokens"
    file.write_text("# for the kit\n" + "".join(f"{role} {secret}\n" for role, secret in secrets.items()))
    only = ("--only", "SEC", "--only", "LEA-8", "--only", "CON-3", "--only", "FRM-2/merged")
    async with serving("conformance.yaml", keys=keys) as port:
        status, out, err = await run(
            "conformance", f"127.0.0.1:{port}", *only, "--token-file", file, "--tls-ca", authority.file
        )
    assert (status, err) == (0, ""), out
    passed = set(re.findall(r"^PASS +PASS +(\S+)", out, re.MULTILINE))
    assert {"SEC-2/none", "SEC-3/above", "SEC-5/robots", "SEC-10/plain"} <= passed
    assert "the server has tokens" in out


async def test_no_report_holds_a_token():
    log = WireLog()
    wire = Wire("w", log, Ledger(), 1.0)
    wire.connection_made(Mute())
    wire.say({"type": "hello", "name": "n", "token": "armgate_secret"})
    (_, line) = log.lines()
    assert "armgate_secret" not in line
    assert b"armgate_secret".hex() not in line.replace(" ", "")


async def test_a_server_with_two_versions():
    async with serving("conformance.yaml", dialects=BOTH) as port:
        target = Target("127.0.0.1", port)
        facts = await ask(target, None, ())
        runner = Runner(target, facts)
        results = [r async for r in runner.run(selected(["VER", "EVO-8", "CMD-20", "STA-10", "SIG-1"]))]
    assert [(r.case.id, r.findings) for r in results if r.outcome is not Outcome.PASS] == []
