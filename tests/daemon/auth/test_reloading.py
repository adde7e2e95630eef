"""Tokens and certificates that are reloaded at SIGHUP."""

import io
import json

import pytest

from armgate.daemon.auth.reloading import Reloader, ReloadSource
from armgate.daemon.auth.tls import TlsError
from armgate.daemon.auth.tokens import TokenError
from armgate.links.log import Log
from support.clients import until


@pytest.mark.parametrize(
    "error", [TokenError("tokens:1: no"), TlsError("cell.key: no"), FileNotFoundError(2, "No such file")]
)
async def test_after_a_file_that_cannot_be_read_a_later_request_reads_it(error):
    stream, found, used = io.StringIO(), [error, "new"], []

    def read():
        one = found.pop(0)
        if isinstance(one, Exception):
            raise one
        return one

    log = Log(stream)
    rereading = Reloader([ReloadSource("tokens", read, lambda new: used.append(new) or {})], log)
    for left in (1, 0):
        rereading.request()
        await until(lambda: rereading._task is None, turns=10**7)
        assert len(found) == left
    log.close()
    assert used == ["new"]
    assert [json.loads(line)["event"] for line in stream.getvalue().splitlines()] == [
        "tokens.kept", "tokens.read",
    ]  # fmt: skip


async def test_after_a_defect_a_later_request_reads_again():
    log, used = Log(io.StringIO()), []
    source = ReloadSource("tokens", lambda: "new", lambda new: used.append(new) or used.index("other"))
    rereading = Reloader([source], log)
    for count in (1, 2):
        rereading.request()
        with pytest.raises(ValueError, match="not in list"):
            await rereading._task
        assert len(used) == count
    log.close()
