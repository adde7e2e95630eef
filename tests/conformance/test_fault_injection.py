"""Injected network faults: delays lose nothing, and a lost connection leaves the robot at rest."""

import asyncio
import contextlib

import pytest

from armgate.cell.cell import build_cell
from armgate.cell.config import load_config
from armgate.client import aio
from armgate.conformance.case import select_cases
from armgate.conformance.fault_injection import FaultError, Faults, Proxy
from armgate.conformance.runner import Runner
from armgate.conformance.target import Target, query_server
from armgate.protocol import messages as m
from conformance.conftest import CONFIGS, TIMEOUT, serving
from support.clients import Raw


class Echo:
    """Server that returns what it receives, and keeps a copy."""

    def __init__(self):
        self.received = bytearray()
        self.ended = asyncio.get_running_loop().create_future()

    async def serve(self, reader, writer):
        try:
            while data := await reader.read(65536):
                self.received += data
                writer.write(data)
            self.ended.set_result("end")
        except ConnectionError:
            self.ended.set_result("reset")
        finally:
            writer.close()


@contextlib.asynccontextmanager
async def echoing(faults, seed=1):
    """Connect to an echo server through a proxy."""
    echo = Echo()
    server = await asyncio.start_server(echo.serve, "127.0.0.1", 0)
    async with server, Proxy("127.0.0.1", server.sockets[0].getsockname()[1], faults, seed) as proxy:
        reader, writer = await asyncio.open_connection("127.0.0.1", proxy.port)
        try:
            async with asyncio.timeout(TIMEOUT):
                yield echo, proxy, reader, writer
        finally:
            writer.close()


DATA = bytes(range(256)) * 40


@pytest.mark.parametrize(
    "text",
    [
        "",
        "slice=1",
        "slice=7,latency=2ms",
        "latency=5ms,jitter=5ms",
        "stall=30ms,every=10ms",
        "bandwidth=400k",
    ],
)
async def test_bytes_arrive_complete_and_in_order(text):
    async with echoing(Faults.parse(text)) as (_, _, reader, writer):
        for start in range(0, len(DATA), 1000):
            writer.write(DATA[start : start + 1000])
            await asyncio.sleep(0)
        assert await reader.readexactly(len(DATA)) == DATA


async def test_latency_delays_both_ways():
    loop = asyncio.get_running_loop()
    async with echoing(Faults.parse("latency=40ms")) as (_, _, reader, writer):
        start = loop.time()
        writer.write(b"x")
        await reader.readexactly(1)
        assert loop.time() - start >= 0.08


@pytest.mark.parametrize(("fault", "how"), [("cut", "end"), ("reset", "reset")])
async def test_a_connection_ends_after_a_number_of_bytes(fault, how):
    async with echoing(Faults.parse(f"{fault}=100")) as (echo, _, reader, writer):
        writer.write(b"x" * 300)
        with contextlib.suppress(ConnectionError):
            while await reader.read(1000):
                pass
        assert await echo.ended == how
        assert len(echo.received) <= 100
        if fault == "cut":
            assert len(echo.received) == 100


async def test_silence_keeps_the_connection_open():
    async with echoing(Faults.parse("silence=100")) as (echo, _, reader, writer):
        writer.write(b"x" * 60)
        await reader.readexactly(60)
        writer.write(b"y" * 100)
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(reader.readexactly(1), 0.2)
        assert len(echo.received) == 100
        assert not echo.ended.done()


@pytest.mark.parametrize("text", ["colour=3", "latency", "latency=fast", "latency=3k", "slice=3ms", "cut=-1"])
def test_an_invalid_fault_is_an_error(text):
    with pytest.raises(FaultError, match="--faults"):
        Faults.parse(text)


def test_faults_are_parsed():
    faults = Faults.parse("latency=80ms, jitter=0.04s,slice=7,bandwidth=64k")
    assert faults == Faults(latency=0.08, jitter=0.04, slice=7, bandwidth=65536.0)
    assert faults.delay == pytest.approx(0.24)


async def test_cases_pass_with_sliced_packets():
    ids = [
        "FRM-1/one",
        "FRM-2",
        "PAY-2/garbage",
        "LEA-8/takeover",
        "CMD-3/order",
        "CMD-20/admitted",
        "CON-3/bye",
        "STP-5",
    ]
    faults = Faults.parse("slice=64,latency=2ms,jitter=1ms")
    async with serving("conformance.yaml") as port, Proxy("127.0.0.1", port, faults) as proxy:
        target = Target("127.0.0.1", port, faults=faults, proxy=proxy)
        server = await query_server(target, None, ())
        results = [r async for r in Runner(target, server).run(select_cases(ids))]
    assert len(results) > 8
    assert not [(r.case.id, r.findings) for r in results if r.failed(strict=True)]


async def test_no_request_follows_a_half_close_by_the_kit():
    faults = Faults.parse("latency=20ms")
    async with serving("conformance.yaml") as port, Proxy("127.0.0.1", port, faults) as proxy:
        target = Target("127.0.0.1", port, faults=faults, proxy=proxy)
        server = await query_server(target, None, ())
        (result,) = [r async for r in Runner(target, server).run(select_cases(["LEA-16/half-close"]))]
    assert not result.failed(strict=True), result.findings


FAR = Faults(latency=0.08, jitter=0.04, stall=0.4, every=1.0)
"""80 ms ± 40 ms each way, and stalls of 200 to 400 ms, as after lost packets in a TCP connection."""


def far_cell(_):
    """Return a cell for a distant controller."""
    config = load_config([CONFIGS / "conformance.yaml"])
    server = config.server.model_copy(update={"lease_ttl": 2.0})
    return build_cell(config.model_copy(update={"max_age_ticks": 150, "server": server}))


@pytest.mark.slow
async def test_a_distant_controller_works_and_its_robot_rests_after_the_connection_is_lost():
    async with serving("", build=far_cell) as port:
        observer = await Raw.hello(port, "observer", "observer")
        observer.send(m.Subscribe(robots=("A",)))
        async with Proxy("127.0.0.1", port, FAR) as proxy:
            far = await aio.connect(f"127.0.0.1:{proxy.port}", name="far", timeout=TIMEOUT)
            robot = await far.acquire("A")
            causes = await commanded(robot, 25)
            assert causes.count(None) >= 20, causes
            assert not set(causes) & {"lease", "fence", "stale"}, causes
            held = await newest(observer)
            assert held.holder == "far"
            assert held.setpoint != (await start(observer))
            proxy.hold()
            lost = entry(await observer.get(m.State, lambda state: entry(state).holder is None))
            one, two = await newest(observer), await newest(observer)
            assert lost.setpoint == one.setpoint == two.setpoint
            assert one.setpoint == pytest.approx(held.setpoint, abs=0.01)
        await far.close()
        await Raw.close_all()


async def commanded(robot, count):
    """Send commands; return the cause of refusal of each, None if it was not refused."""
    causes = []
    async for _ in robot.ticks():
        causes.append(await sent(robot, len(causes)))
        if len(causes) == count:
            break
    return causes


async def start(observer):
    """Return the start position of the robot."""
    observer.send(m.Describe())
    return (await observer.get(m.Description)).robots[0].start


async def sent(robot, count):
    """Send a command; return the cause of its refusal, None if it was not refused."""
    verdict = await robot.send([0.0005 if count % 20 < 10 else -0.0005, 0.0, 0.0])
    return verdict.reasons[0].cause if verdict.outcome == "refused" else None


def entry(state):
    return next(e for e in state.entries if e.robot == "A")


async def newest(observer):
    observer.send(m.Ping(time=0.0))
    await observer.get(m.Pong)  # drops the messages that waited to be read
    return entry(await observer.get(m.State))
