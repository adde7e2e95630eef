"""The daemon conforms to its specification: every case passes, by the wall clock and in lock-step."""

import sys
from xml.etree import ElementTree as ET

import pytest

from support.clients import launch

SERVE = f"{sys.executable} -m armgate.apps serve configs/conformance.yaml"
LOAD_DEPENDENT = {"CMD-13/just", "LEA-20/speed", "SUB-8/slow", "STP-10/moving", "CMD-36/clearance"}
"""Cases that are skipped if the machine is too busy, or too idle, to produce the situation."""

OTHER_SERVERS = (
    "only for a server", "--token-file", "--tls-ca", "the server supports only one version",
    "the links of all robots are ready",
)  # fmt: skip


async def conformance(*arguments):
    """Run the command; return its exit status and stdout."""
    process = await launch("conformance", *map(str, arguments))
    out, err = await process.communicate()
    assert not err.decode(), err.decode()
    return process.returncode, out.decode()


def cases(file):
    """Return the cases of a JUnit report by id."""
    return {one.get("name").split()[0]: one for one in ET.parse(file).iter("testcase")}


@pytest.mark.parametrize(
    ("more", "least"),
    [
        pytest.param((), 298, id="wall", marks=pytest.mark.slow),
        pytest.param(("configs/conformance-lockstep.yaml",), 18, id="lock-step"),
    ],
)
async def test_the_daemon_passes_all_cases(tmp_path, more, least):
    start = " ".join((SERVE, *more, "--port 0"))
    status, out = await conformance("--start", start, "--participants", "kit-a,kit-b", "--out", tmp_path)
    found = cases(tmp_path / "junit.xml")
    skipped = {
        name: one.find("skipped").get("message")
        for name, one in found.items()
        if len(one) and one.find("skipped") is not None
    }
    unexpected = {
        n: why
        for n, why in skipped.items()
        if not any(e in why for e in OTHER_SERVERS) and n not in LOAD_DEPENDENT
    }
    assert status == 0, "\n".join(line for line in out.splitlines() if "FAIL" in line or ": " in line[:14])
    assert not unexpected
    passed = len(found) - len(skipped)
    assert passed >= least
    assert out.splitlines()[-1] == f"{len(found)} cases, {passed} passed, 0 failed, {len(skipped)} skipped"
    assert list((tmp_path / "wire").iterdir()) == []
