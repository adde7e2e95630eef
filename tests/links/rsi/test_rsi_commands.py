"""`armgate rsi`: its files fit the cell, and it compares telegrams with the cell."""

import asyncio
import contextlib
import math
import socket
import sys

import pytest
from typer.testing import CliRunner

from armgate.cell.cell import build_cell
from armgate.cell.config import load_config
from armgate.cell.errors import ConfigError
from armgate.emulator.krc import kr16
from armgate.emulator.krc import read_ethernet as krc_reads
from armgate.links.rsi.commissioning.axis_directions import AxisDirections
from armgate.links.rsi.commissioning.command import _flange_in_foot, rsi
from armgate.links.rsi.setup import setup_of
from support.clients import PATIENCE, run
from support.krcs import krc_file
from support.rsi import SEND, SIX, cell_text


def ran(*arguments):
    return CliRunner().invoke(rsi, [str(one) for one in arguments])


@pytest.mark.parametrize("generation", ["rsi2", "rsi3"])
@pytest.mark.parametrize(("gantry", "mode"), [(False, "absolute"), (True, "relative")])
def test_link_and_krc_accept_the_files_that_config_writes(tmp_path, generation, gantry, mode):
    file = cell_text(tmp_path, gantry=gantry, mode=mode)
    (tmp_path / "krc.xml").unlink()
    options = (
        "--robot", "R", "--pc", "192.168.1.10:49200", "--generation", generation, "--sentype", "a<b",
        "--out", tmp_path,
    )  # fmt: skip
    result = ran("config", file, *options)
    assert result.exit_code == 0, result.output
    cell = build_cell(load_config([file]))
    assert setup_of(cell, cell.robots[0]).listen == ("192.168.1.10", 49200)
    other = krc_reads((tmp_path / "krc.xml").read_bytes())
    assert other.sentype == "a<b"
    assert [e.name for e in other.received][-1] == ("EK.E3" if gantry else "AK.A6")
    program = (tmp_path / "armgate_rsi.src").read_text()
    assert ("ST_SKIPSENS" if generation == "rsi2" else "RSI_MOVECORR") in program
    assert ("#RELATIVE" if mode == "relative" else "#ABSOLUTE") in program
    assert type(ran("config", file, *options).exception).__name__ == "RsiUsageError"
    assert ran("config", file, *options, "--force").exit_code == 0


def test_config_with_wrong_options_is_a_usage_error(tmp_path):
    file = cell_text(tmp_path)
    for options, expected in (
        (("--robot", "X"), "there is no robot"),
        (("--robot", "R"), "expected --pc"),
        (("--robot", "R", "--pc", "10.0.0.1:99999"), "expected a number from 1 to 65535"),
        (("--robot", "R", "--pc", "10.0.0.1:5", "--sentype", " "), "SENTYPE> is missing or empty"),
    ):
        error = ran("config", file, *options, "--out", tmp_path).exception
        assert expected in str(error)
        assert error.exit_code == 2
    with pytest.raises(ConfigError):
        raise ran("config", tmp_path / "none.yaml", "--robot", "R").exception


def test_check_names_an_address_of_another_machine(tmp_path):
    """The link's address has to belong to this machine; 192.0.2.0/24 is reserved for documentation."""
    error = ran("check", cell_text(tmp_path, listen="192.0.2.1:49152"), "--robot", "R").exception
    assert error.filename == "UDP 192.0.2.1:49152"
    assert "expected an address of this machine" in error.strerror


async def test_a_robot_server_names_an_address_of_another_machine(tmp_path):
    file = cell_text(tmp_path, listen="192.0.2.1:49152")
    status, out, err = await run("robot-server", file, "--socket", tmp_path / "s")
    assert (status, out) == (2, "")
    assert err.startswith("armgate: cannot open the links to the robots: UDP 192.0.2.1:49152: ")


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


async def checked(folder, *krc, start="15,-80,85,20,35,40", **link):
    """Return exit status and lines of ``armgate rsi check`` for a KRC."""
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


@pytest.mark.slow
async def test_check_of_a_krc_that_fits(tmp_path):
    status, out = await checked(tmp_path, "--precision", "6")
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


@pytest.mark.slow
async def test_check_names_every_mismatch(tmp_path):
    own = "{A1: {joint: A1, received: -1.0, sent: -1.0}}"
    status, out = await checked(tmp_path, "--precision", "1", axes=own)
    assert status == 1
    assert "WRONG: set Precision" in out
    assert "A1 turn(s) the other way" in out


@pytest.mark.parametrize("turned", ["", "A1", "A4", "A6"])
def test_an_axis_that_turns_the_other_way_is_found_after_all_axes_were_jogged(tmp_path, turned):
    cell = build_cell(load_config([cell_text(tmp_path)]))
    setup = setup_of(cell, cell.robots[0])
    signs = AxisDirections(setup, _flange_in_foot(cell.robots[0]))
    for jogged in ((0.0, -90.0, 90.0, 0.0, 45.0, 0.0), (10.0, -80.0, 85.0, 15.0, 35.0, 20.0)):
        names = [axis.name for axis in setup.axes]
        krc = [-one if name == turned else one for name, one in zip(names, jogged, strict=True)]
        pose = zip("XYZABC", kr16().chain.pose(krc), strict=True)
        signs.take([math.radians(one) for one in jogged], rist(pose))
    line, problem = signs.report()
    assert "would fit here too" not in line
    assert problem is None if not turned else f"if {turned} turn(s) the other way" in problem


def rist(pose):
    values = " ".join(f'{name}="{value:.6f}"' for name, value in pose)
    return f"<RIst {values}/>".encode()


@pytest.mark.daily(1)
@pytest.mark.parametrize(
    ("hold", "status", "expected"), [(1, 0, "by RSI with the KRC at"), (0, 2, "would command a jump back")]
)
async def test_armgate_check_reads_the_krcs_file_too(tmp_path, hold, status, expected):
    file = cell_text(tmp_path, file=krc_file(SEND, SIX, hold=hold))
    ended, out, err = await run("check", file)
    assert ended == status, err
    assert expected in out + err
