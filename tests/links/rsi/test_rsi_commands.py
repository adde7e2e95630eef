"""`armgate rsi`: the files that it writes fit the cell, and what it hears is held against it."""

import asyncio
import contextlib
import socket
import sys

import pytest
from typer.testing import CliRunner

from armgate.cell.cell import build_cell
from armgate.cell.config import load_config
from armgate.cell.errors import ConfigError
from armgate.emulator.krc import read_ethernet as krc_reads
from armgate.links.rsi import setup_of
from armgate.links.rsi.command import rsi
from support.clients import PATIENCE
from support.rsi import cell_text


def ran(*arguments):
    return CliRunner().invoke(rsi, [str(one) for one in arguments])


@pytest.mark.parametrize("generation", ["rsi2", "rsi3"])
@pytest.mark.parametrize(("gantry", "mode"), [(False, "absolute"), (True, "relative")])
def test_what_config_writes_is_what_link_and_krc_take(tmp_path, generation, gantry, mode):
    file = cell_text(tmp_path, gantry=gantry, mode=mode)
    (tmp_path / "krc.xml").unlink()
    options = ("--robot", "R", "--pc", "192.168.1.10:49200", "--generation", generation, "--out", tmp_path)
    result = ran("config", file, *options)
    assert result.exit_code == 0, result.output
    cell = build_cell(load_config([file]))
    assert setup_of(cell, cell.robots[0]).listen == ("192.168.1.10", 49200)
    other = krc_reads((tmp_path / "krc.xml").read_bytes())
    assert [e.name for e in other.received][-1] == ("EK.E3" if gantry else "AK.A6")
    program = (tmp_path / "armgate_rsi.src").read_text()
    assert ("ST_SKIPSENS" if generation == "rsi2" else "RSI_MOVECORR") in program
    assert ("#RELATIVE" if mode == "relative" else "#ABSOLUTE") in program
    assert type(ran("config", file, *options).exception).__name__ == "CalledWronglyError"
    assert ran("config", file, *options, "--force").exit_code == 0


def test_config_called_wrongly(tmp_path):
    file = cell_text(tmp_path)
    for options, said in ((("--robot", "X"), "there is no robot"), (("--robot", "R"), "expected --pc")):
        error = ran("config", file, *options, "--out", tmp_path).exception
        assert said in str(error)
        assert error.exit_code == 2
    with pytest.raises(ConfigError):
        raise ran("config", tmp_path / "none.yaml", "--robot", "R").exception


@contextlib.asynccontextmanager
async def process(*arguments):
    pipe = asyncio.subprocess.PIPE
    child = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "armgate.apps", *map(str, arguments), stdout=pipe, stderr=pipe
    )
    try:
        yield child
    finally:
        if child.returncode is None:
            child.kill()
        await child.communicate()


async def heard(folder, *krc, start="15,-80,85,20,35,40", **link):
    """What ``armgate rsi check`` says of a KRC: its exit status and its lines."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as own:
        own.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{own.getsockname()[1]}"
    file = cell_text(folder, cycle=0.012, krc="127.0.0.1", listen=f'"{address}"', **link)
    given = (
        "--config",
        folder / "krc.xml",
        "--to",
        address,
        "--cell",
        file,
        "--robot",
        "R",
        "--timeout",
        10**6,
    )
    async with process("rsi", "check", file, "--robot", "R", "--seconds", "1") as checking:
        async with asyncio.timeout(PATIENCE):
            assert b"never answers" in await checking.stderr.readline()
        options = ("--profile", "krc4-rsi3", "--cycle", "12", "--start", start, "--timeout", 10**6)
        async with process("krc", *options, *given, *krc):
            async with asyncio.timeout(PATIENCE):
                out, _ = await checking.communicate()
    return checking.returncode, out.decode()


async def test_check_of_a_krc_that_fits(tmp_path):
    status, out = await heard(tmp_path, "--precision", "6")
    assert status == 0, out
    for text in (
        "cycle: 1",
        "in steps of 12",
        "elements: RIst, ",
        "decimals: 6",
        "RIst: 0.0 mm",
        "fits the cell",
    ):
        assert text in out


async def test_check_names_what_does_not_fit(tmp_path):
    own = "{A1: {joint: A1, received: -1.0, sent: -1.0}}"
    status, out = await heard(tmp_path, "--precision", "1", axes=own)
    assert status == 1
    assert "WRONG: set Precision" in out
    assert "A1 turn(s) the other way" in out
