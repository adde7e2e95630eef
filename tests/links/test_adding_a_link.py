"""A kind of link from another package, installed by pip: every command works with it."""

import asyncio
import contextlib
import http.client
import os
import re
import signal
import subprocess
import sys
import urllib.parse
from pathlib import Path

import pytest

from armgate.protocol import messages as m
from support.clients import PATIENCE, Mover, Process, Raw, launch, run
from support.ports import free_ports
from support.robot_servers import RobotServer, lift_stops, stopped_by_the_gate

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "linebot"
CELL = EXAMPLE / "cell.yaml"
DQ = (0.004, 0.002)


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    """Return the folder into which pip has installed the example."""
    folder = tmp_path_factory.mktemp("installed")
    offline = ("--no-index", "--no-build-isolation", "--no-deps", "--no-compile", "--quiet")
    pip = (sys.executable, "-m", "pip", "install", *offline, "--target", str(folder), str(EXAMPLE))
    subprocess.run(pip, check=True, timeout=300, stdin=subprocess.DEVNULL)
    return folder


@pytest.fixture
def installed(package, monkeypatch):
    """Put the package on the path of new processes."""
    monkeypatch.setenv("PYTHONPATH", str(package))


@pytest.fixture
def cell(tmp_path):
    """Return the files of the example's cell, on a free port and with a timeout for a busy machine."""
    file = tmp_path / "port.yaml"
    file.write_text(f"armgate: 1\nrobots: {{head: {{link: {{port: {free_ports(1)[0]}, silence: 2 s}}}}}}\n")
    return CELL, file


def entry_point(folder, package, value):
    """Install a package that declares the kind ``linebot`` and has no code."""
    info = folder / f"{package}-1.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1\n")
    (info / "entry_points.txt").write_text(f"[armgate.links]\nlinebot = {value}\n")


@contextlib.asynccontextmanager
async def virtual_robot(cell):
    process = await launch("linebot", *map(str, cell), "--robot", "head")
    try:
        async with asyncio.timeout(PATIENCE):
            assert (await process.stdout.readline()).startswith(b"linebot: at "), await process.stderr.read()
        yield process
    finally:
        if process.returncode is None:
            process.kill()
        await process.communicate()


@contextlib.asynccontextmanager
async def viewer(address):
    process = await launch("view", address, "--port", "0", "--no-meshes")
    try:
        async with asyncio.timeout(PATIENCE):
            line = (await process.stdout.readline()).decode()
        yield line.removeprefix("armgate: view at ").strip()
    finally:
        process.terminate()
        await process.communicate()


def page_status(url):
    """Return the HTTP status of the viewer's page, opened by its link with the secret."""
    address = urllib.parse.urlsplit(url)

    def response(path, **headers):
        connection = http.client.HTTPConnection(address.netloc, timeout=PATIENCE)
        with contextlib.closing(connection):
            connection.request("GET", path, headers=headers)
            return connection.getresponse()

    first = response(f"{address.path}?{address.query}")
    return response("/", Cookie=first.headers["Set-Cookie"].partition(";")[0]).status


async def mover_of(daemon, name):
    """Wait for the robot; return a controller whose commands move it."""
    observer = await Raw.hello(daemon.port, f"{name}-waits", "observer")
    observer.send(m.Subscribe())
    await observer.get(m.State, lambda state: state.entries[0].link == "ready")
    mover = await Mover.start(daemon.port, "head", name, DQ)
    await mover.moves_on(10)
    return mover


@pytest.mark.slow
async def test_check_reports_the_link(installed):
    status, out, err = await run("check", CELL)
    assert (status, err) == (0, "")
    assert "head: lines of text over TCP, robot at 127.0.0.1:7450" in out


@pytest.mark.daily(1)
@pytest.mark.parametrize(
    ("packages", "error"),
    [
        ({}, "kind 'linebot' is not installed; expected one of emulated, rsi, or install the package"),
        (
            {"one": "nothing_here:KIND"},
            r"nothing_here:KIND of the package one cannot be imported \(ModuleNotFoundError: No module named "
            r"'nothing_here'\); repair or uninstall it",
        ),
        ({"one": "json:dumps"}, "json:dumps of the package one is not a LinkKind; repair or uninstall it"),
        (
            {"one": "json:dumps", "two": "json:loads"},
            r"comes from 2 packages \(one, two\); uninstall all but",
        ),
    ],
)
async def test_a_kind_that_cannot_be_used_is_one_error_with_file_and_line(
    tmp_path, monkeypatch, packages, error
):
    for name, value in packages.items():
        entry_point(tmp_path, name, value)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    line = CELL.read_text().splitlines().index("      kind: linebot") + 1
    for command in ("check", "serve", "robot-server"):
        status, out, err = await run(command, CELL)
        assert (status, out) == (2, "")
        assert re.fullmatch(
            rf"armgate: \S+cell\.yaml:{line}: robots\.head\.link\.kind: .*{error}.*\n", err
        ), err


async def test_an_unknown_key_is_named_with_the_keys_of_its_kind(installed, tmp_path):
    overlay = tmp_path / "overlay.yaml"
    overlay.write_text("armgate: 1\nrobots: {head: {link: {prt: 1}}}\n")
    status, _, err = await run("check", CELL, overlay)
    assert status == 2
    assert "robots.head.link.prt: unknown key 'prt'; did you mean 'port'? expected one of kind, lag" in err


async def test_a_configuration_imports_no_other_kind(installed):
    code = (
        "import sys; from pathlib import Path; from armgate.cell.config import load_config\n"
        f"load_config([Path({str(CELL)!r})])\n"
        "assert 'armgate_linebot.kind' in sys.modules and 'armgate_linebot.link' not in sys.modules\n"
        "assert not [name for name in sys.modules if name.startswith(('armgate.links.rsi', 'pinocchio'))]\n"
    )
    done = await asyncio.to_thread(
        subprocess.run, [sys.executable, "-c", code], capture_output=True, text=True, timeout=PATIENCE
    )
    assert (done.returncode, done.stderr) == (0, "")


async def test_the_robot_moves_stops_at_a_fault_and_moves_again_after_a_reset(installed, cell, tmp_path):
    async with (
        virtual_robot(cell) as robot,
        RobotServer.running(*cell, socket=tmp_path / "s") as server,
        Process.serving(*cell, "--robot-server", tmp_path / "s", "--record", tmp_path / "run") as daemon,
    ):
        observer = await Raw.hello(daemon.port, "observer", "observer")
        mover = await mover_of(daemon, "one")
        robot.send_signal(signal.SIGUSR1)  # its stop button
        reasons = await stopped_by_the_gate(observer, ["head"])
        assert reasons["head"].endswith("the stop button was pressed")
        await mover.stop()
        await lift_stops(daemon.port)
        await (await mover_of(daemon, "two")).stop()
        daemon.signal()
        assert (await daemon.end())[0] == 0
        server.signal()
        assert await server.end() == 0
    for check in ("replay", "monitor"):
        status, out, err = await run(check, tmp_path / "run")
        assert (status, err) == (0, ""), out


@pytest.mark.slow
async def test_the_link_is_lost_with_its_connection_and_comes_back_at_rest(installed, cell, tmp_path):
    async with (
        RobotServer.running(*cell, socket=tmp_path / "s"),
        Process.serving(*cell, "--robot-server", tmp_path / "s") as daemon,
    ):
        observer = await Raw.hello(daemon.port, "observer", "observer")
        async with virtual_robot(cell):
            mover = await mover_of(daemon, "one")
        reasons = await stopped_by_the_gate(observer, ["head"])
        assert reasons["head"].startswith("the link to head is lost")
        await mover.stop()
        async with virtual_robot(cell):
            await lift_stops(daemon.port)
            await (await mover_of(daemon, "two")).stop()


@pytest.mark.slow
async def test_the_viewer_shows_the_robot(installed, cell, tmp_path):
    async with (
        virtual_robot(cell),
        RobotServer.running(*cell, socket=tmp_path / "s"),
        Process.serving(*cell, "--robot-server", tmp_path / "s") as daemon,
        viewer(f"127.0.0.1:{daemon.port}") as url,
    ):
        assert await asyncio.to_thread(page_status, url) == 200
        guest = await Raw.hello(daemon.port, "guest", "operator")
        guest.send(m.Subscribe())
        state = await guest.get(m.State, lambda s: s.entries[0].link == "ready")
        assert state.entries[0].q


async def test_the_virtual_robot_ends_without_a_message_if_a_link_is_connected(installed, cell):
    async with virtual_robot(cell) as robot:
        (port,) = re.findall(r"port: (\d+)", cell[1].read_text())
        reader, writer = await asyncio.open_connection("127.0.0.1", int(port))
        assert (await reader.readline()).startswith(b"POS ")
        robot.send_signal(signal.SIGINT)
        async with asyncio.timeout(PATIENCE):
            _, err = await robot.communicate()
        writer.close()
    assert (robot.returncode, err) == (0, b"")


def test_a_command_that_starts_the_whole_cell_starts_the_virtual_robot(installed, tmp_path):
    code = (
        "from pathlib import Path; from armgate.cell.config import load_config\n"
        "from armgate.apps.stack.robot_processes import robots_of\n"
        f"files = [Path({str(CELL)!r})]\n"
        f"print(robots_of(load_config(files), files, Path({str(tmp_path)!r})).virtual)\n"
    )
    found = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=PATIENCE, check=True
    )
    assert found.stdout == f"{{'linebot-head': ['linebot', '{CELL}', '--robot', 'head']}}\n"


def test_the_tutorial_shows_the_files_of_the_example_word_for_word():
    text = (ROOT / "docs" / "adding-a-link.md").read_text(encoding="utf-8")
    shown = re.findall(r"^```(?:toml|python|yaml)\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    folder = EXAMPLE / "src" / "armgate_linebot"
    files = [EXAMPLE / "pyproject.toml", folder / "kind.py", folder / "link.py", folder / "device.py", CELL]
    assert shown == [file.read_text(encoding="utf-8") for file in files]
    assert os.fspath(EXAMPLE.relative_to(ROOT)) in text
