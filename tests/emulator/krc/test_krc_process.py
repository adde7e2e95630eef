"""Tests of ``armgate krc`` as a process, with a PC that answers over UDP like public drivers."""

import asyncio
import contextlib
import json
import signal
import sys

import pytest

from support.clients import PATIENCE, run
from support.krcs import FILES, ipoc_of, krc_file, sen, values_of
from support.ports import free_ports

STEP = (0.05, 0.0, 0.0, 0.0, 0.0, 0.0)


class Driver(asyncio.DatagramProtocol):
    """PC that answers each telegram at once: with zeros first, then with ``axes``."""

    def __init__(self):
        self.seen, self.sources, self.axes = [], [], (0.0,) * 6
        self.news = asyncio.Event()
        self.answering = True

    def connection_made(self, transport):
        self.transport = transport

    def datagram_received(self, data, source):
        self.seen.append(data)
        self.sources.append(source)
        if self.answering:
            self.transport.sendto(sen(ipoc_of(data), self.axes), source)
        self.news.set()

    async def until(self, condition):
        async with asyncio.timeout(PATIENCE):
            while not condition():
                self.news.clear()
                await self.news.wait()

    async def further(self, count=5):
        goal = len(self.seen) + count
        await self.until(lambda: len(self.seen) >= goal)


class Krc:
    """Process of a virtual KRC, and its PC."""

    def __init__(self, process, driver):
        self.process, self.driver = process, driver

    @classmethod
    @contextlib.asynccontextmanager
    async def running(cls, tmp_path, *options, profile="krc4-rsi3", text=None):
        config = tmp_path / "krc.xml"
        config.write_text(text or krc_file())
        loop = asyncio.get_running_loop()
        transport, driver = await loop.create_datagram_endpoint(Driver, local_addr=("127.0.0.1", 0))
        to = f"127.0.0.1:{transport.get_extra_info('sockname')[1]}"
        # A busy machine answers late; lateness is not tested here.
        given = ("--profile", profile, "--config", str(config), "--to", to, "--timeout", "1000000", *options)
        pipe = asyncio.subprocess.PIPE
        process = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "armgate.apps", "krc", *given, stdin=pipe, stdout=pipe, stderr=pipe
        )
        try:
            krc = cls(process, driver)
            krc.ready = await krc._line()
            yield krc
        finally:
            transport.close()
            if process.returncode is None:
                process.kill()
            await process.communicate()

    async def _line(self):
        async with asyncio.timeout(PATIENCE):
            return (await self.process.stdout.readline()).decode()

    async def command(self, line):
        self.process.stdin.write(f"{line}\n".encode())
        return json.loads(await self._line())

    async def end(self, number=signal.SIGTERM):
        self.process.send_signal(number)
        async with asyncio.timeout(PATIENCE):
            _, errors = await self.process.communicate()
        return self.process.returncode, [json.loads(line) for line in errors.decode().splitlines()]


@pytest.mark.parametrize("profile", ["krc2-rsi2", "krc4-rsi3", "krc5-rsi5"])
async def test_the_process_exchanges_rsi_with_a_driver_until_a_signal(tmp_path, profile):
    async with Krc.running(tmp_path, "--precision", "4", profile=profile) as krc:
        assert krc.ready.startswith(f"armgate: {profile} sends from port ")
        await krc.driver.further(10)
        krc.driver.axes = STEP
        await krc.driver.until(lambda: values_of(krc.driver.seen[-1], "AIPos")[0] > 0.04)
        status = await krc.command("status")
        assert status["state"] == "running"
        assert status["setpoint"]["A1"] == 0.05
        assert status["network"]["to-pc"]["passed"] >= 12
        returned, log = await krc.end()
    assert returned == 0
    assert [record["event"] for record in log if record["level"] == "info"] == ["waiting", "running", "end"]


async def test_the_supplied_ethernet_file_works(tmp_path):
    file = (FILES / "axis-correction.xml").read_text().replace("armgate</SENTYPE>", "ImFree</SENTYPE>")
    async with Krc.running(tmp_path, text=file) as krc:
        await krc.driver.further(3)
        status, _ = await krc.end(signal.SIGINT)
    assert status == 0


async def test_a_given_port_is_kept_through_a_restart(tmp_path):
    (port,) = free_ports(1)
    async with Krc.running(tmp_path, "--port", str(port)) as krc:
        await krc.driver.further(3)
        await krc.command("restart")
        await krc.driver.further(3)
        assert {source[1] for source in krc.driver.sources} == {port}
        status, _, err = await run(
            "krc", "--profile", "krc4-rsi3", "--config", str(tmp_path / "krc.xml"), "--port", str(port)
        )
    assert (status, err) == (2, f"armgate: cannot send from port {port}: Address already in use\n")


async def test_the_process_waits_for_start_and_has_a_new_port_after_a_restart(tmp_path):
    async with Krc.running(tmp_path, "--stopped", "--ipoc", "8") as krc:
        assert (await krc.command("ipoc 400"))["state"] == "stopped"
        assert krc.driver.seen == []
        await krc.command("start")
        await krc.driver.further(3)
        before = krc.driver.sources[-1]
        assert (await krc.command("restart"))["state"] == "waiting"
        await krc.driver.until(lambda: krc.driver.sources[-1] != before)
        assert (await krc.command("fly"))["ok"] is False


async def test_the_cable_can_be_unplugged_in_each_direction(tmp_path):
    async with Krc.running(tmp_path) as krc:
        await krc.driver.further()
        lost = (await krc.command("cable out to-krc"))["network"]["to-krc"]["lost"]
        await krc.driver.further()
        status = await krc.command("cable in to-krc")
        assert status["network"]["to-krc"]["lost"] > lost
        assert status["delay"] > 0
        out = await krc.command("cable out to-pc")
        async with asyncio.timeout(PATIENCE):
            while (status := await krc.command("status"))["cycles"] < out["cycles"] + 20:
                pass
        assert status["network"]["to-pc"]["passed"] == out["network"]["to-pc"]["passed"]
        await krc.command("cable in to-pc")
        await krc.driver.further()


async def test_answers_to_delayed_telegrams_are_rejected_as_late(tmp_path):
    async with Krc.running(tmp_path, "--delay", "to-pc=30") as krc:
        await krc.driver.further(10)
        status = await krc.command("status")
        assert status["delay"] > 0
        assert status["rejected"]["late"] > 0
        assert status["state"] == "waiting"


async def test_a_broken_off_krc_leaves_this_state_only_by_a_reset(tmp_path):
    async with Krc.running(tmp_path, "--timeout", "3") as krc:
        krc.driver.answering = False
        async with asyncio.timeout(PATIENCE):
            while (status := await krc.command("status"))["state"] != "broken_off":
                pass
        assert status["message"].startswith("KSS29002")
        krc.driver.answering = True
        assert (await krc.command("status"))["state"] == "broken_off"
        assert (await krc.command("reset"))["state"] == "stopped"
        _, log = await krc.end()
    assert "broken_off" in [record["event"] for record in log]


async def test_the_log_may_go_to_a_file_and_stdin_may_end(tmp_path):
    async with Krc.running(tmp_path, "--log", str(tmp_path / "krc.log")) as krc:
        krc.process.stdin.close()
        await krc.driver.further(10)
        status, errors = await krc.end()
    assert (status, errors) == (0, [])
    records = [json.loads(line) for line in (tmp_path / "krc.log").read_text().splitlines()]
    assert records[-1]["event"] == "end"
    assert records[-1]["cycles"] >= 10


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (("--profile", "krc9"), "expected one of krc2-rsi2"),
        (("--to", "nowhere"), "expected HOST:PORT"),
        (("--robot", "none.urdf"), "no such URDF file"),
        (("--cycle", "5"), "no cycle of 5 ms"),
        (("--loss", "2"), "expected a probability"),
        (("--config", "none.xml"), "none.xml: No such file"),
    ],
)
async def test_wrong_options_are_usage_errors(tmp_path, options, text):
    config = tmp_path / "krc.xml"
    config.write_text(krc_file())
    given = {"--profile": "krc4-rsi3", "--config": str(config), options[0]: options[1]}
    status, out, err = await run("krc", *(word for pair in given.items() for word in pair))
    assert (status, out) == (2, "")
    assert text in err
    assert "Traceback" not in err
