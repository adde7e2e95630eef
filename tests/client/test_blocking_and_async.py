"""Both shells of the SDK against a fake server on loopback; every test runs for each shell."""

import asyncio
import inspect
import math
import socket
import struct

import numpy as np
import pytest

from armgate.client import (
    BadArgument,
    ConnectionLost,
    LeaseLost,
    Refused,
    Rejected,
    RobotStopped,
    TimedOut,
    aio,
    blocking,
)
from armgate.protocol import messages as m
from armgate.protocol.framing import frame
from support.fake_server import ROBOTS, URDF, URDF_HASH, state, verdict


async def first(items):
    return await anext(aiter(items))


def error(request, code, fatal=False, **more):
    return m.Error(
        re=getattr(request, "id", None), code=code, text="because", fatal=fatal, about=request.type, **more
    )


# --- connecting -------------------------------------------------------------------------------------------


async def test_connect_sends_hello_and_requests_the_description(connect, server):
    async with await connect(role="observer", token="secret") as cell:
        hello = await server.received(m.Hello)
        assert (hello.name, hello.role, hello.token, hello.versions) == ("c", "observer", "secret", (1,))
        assert cell.welcome.session == "session"
        assert [robot.name for robot in cell.description.robots] == list(ROBOTS)
    await server.received(m.Bye)


async def test_connect_without_a_daemon_is_explained(connect, server):
    server.listening.close()
    await server.listening.wait_closed()
    with pytest.raises(ConnectionLost, match=r"no connection to 127\.0\.0\.1:\d+.*armgate serve"):
        await connect()


async def test_invalid_arguments_are_named_and_nothing_is_sent(connect, server):
    with pytest.raises(BadArgument, match="no port"):
        await connect(address="localhost")
    with pytest.raises(BadArgument, match="name"):
        await connect(name="two words")
    assert server.messages_received == []


async def test_a_server_without_a_common_version_rejects_the_client(connect, server):
    text = "no version in common: the server supports [2], the client [1]"
    server.on[m.Hello] = lambda connection, hello: connection.send(
        m.Error(code="version", text=text, fatal=True)
    )
    with pytest.raises(Rejected, match=r"supports \[2\], the client \[1\]") as caught:
        await connect()
    assert caught.value.code == "version"


async def test_a_missing_welcome_times_out(connect, server):
    server.on[m.Hello] = lambda connection, hello: None
    with pytest.raises(TimedOut, match="a welcome did not arrive within"):
        await connect(timeout=0.05)


# --- controllers ------------------------------------------------------------------------------------------


async def test_a_controller_commands_its_robot_and_releases_it(connect, server):
    async with await connect() as cell:
        async with await cell.acquire("FR", speed=0.5) as robot:
            assert (robot.lease.fence, robot.lease.speed) == (1, 0.5)
            tick = await first(robot.ticks())
            assert (tick.tick, tick.q, tick.setpoint) == (0, (0.1, 0.2), (0.3, 0.4))
            assert tick.entry("GR").robot == "GR"
            answer = await robot.send([0.001, -0.002])
            assert answer.outcome == "admitted"
        command = await server.received(m.Command)
        assert (command.robot, command.fence, command.tick, command.dq) == ("FR", 1, 0, (0.001, -0.002))
        assert answer.seq == command.seq
        release = await server.received(m.Release)
        assert (release.robot, release.fence) == ("FR", 1)
    await server.received(m.Bye)


async def test_ticks_yield_the_newest_tick(connect, server):
    async with await connect() as cell, await cell.acquire("FR") as robot:
        ticks = aiter(robot.ticks())
        assert (await anext(ticks)).tick == 0
        server.send(*(state("FR", tick) for tick in range(1, 60)), state("GR", 99))
        assert (await anext(ticks)).tick == 59


async def test_ticks_read_the_socket_before_they_yield(connect, server):
    async with await connect() as cell, await cell.acquire("FR") as robot:
        ticks = aiter(robot.ticks())
        await anext(ticks)
        server.send(state("FR", 1))
        await cell.ping()
        server.send(state("FR", 2), state("FR", 3))
        assert (await anext(ticks)).tick == 3


async def test_states_yield_the_newest_state_of_any_robot(connect, server):
    async with await connect(role="observer") as cell:
        states = aiter(cell.states())
        assert (await anext(states)).tick == 0
        assert (await server.received(m.Subscribe)).robots is None
        server.send(state("FR", 1), state("GR", 5))
        newest = await anext(states)
        assert (newest.robot, newest.tick) == ("GR", 5)
        assert cell.state == newest


async def test_verdicts_on_posted_commands_are_kept_in_order(connect):
    async with await connect() as cell, await cell.acquire("FR") as robot:
        await first(robot.ticks())
        sent = [await robot.post([0.0, 0.0]) for _ in range(20)]
        await robot.send([0.0, 0.0])
        assert [answer.seq for answer in robot.verdicts()] == sent
        assert robot.verdicts() == []


async def test_a_command_is_based_on_the_tick_yielded_last(connect, server):
    async with await connect() as cell, await cell.acquire("FR") as robot:
        await first(robot.ticks())
        server.send(state("FR", 1), state("FR", 2))
        await cell.ping()
        await robot.send([0.0, 0.0])
        assert (await server.received(m.Command)).tick == 0


async def test_a_command_before_the_first_tick_is_an_error(connect):
    async with await connect() as cell, await cell.acquire("FR") as robot:
        with pytest.raises(BadArgument, match=r"robot\.ticks\(\)"):
            await robot.send([0.0, 0.0])


@pytest.mark.parametrize(
    "dq", [np.array([0.25, 0.5]), [np.float32(0.25), np.float64(0.5)], (0.25, 0.5), [0.25, 0.5]]
)
async def test_any_sequence_of_numbers_is_accepted_as_an_increment(connect, server, dq):
    async with await connect() as cell, await cell.acquire("FR") as robot:
        await first(robot.ticks())
        await robot.send(dq)
        assert (await server.received(m.Command)).dq == (0.25, 0.5)


async def test_an_increment_that_is_not_finite_is_sent_and_refused_by_the_server(connect, server):
    server.on[m.Command] = lambda connection, command: connection.send(
        verdict(command, outcome="refused", beta=0.0, reasons=(m.Reason(cause="not_finite", text="nan"),))
    )
    async with await connect() as cell, await cell.acquire("FR") as robot:
        await first(robot.ticks())
        answer = await robot.send([math.nan, math.inf])
        assert (answer.outcome, answer.reasons[0].cause) == ("refused", "not_finite")
        assert math.isnan((await server.received(m.Command)).dq[0])


@pytest.mark.parametrize(("value", "shown"), [(True, "a bool True"), ("x", "a text 'x'"), (None, "nil")])
async def test_an_unreadable_command_is_refused_without_a_verdict(connect, value, shown):
    async with await connect() as cell, await cell.acquire("FR") as robot:
        await first(robot.ticks())
        with pytest.raises(Refused, match=rf"command\.dq\[1\].*{shown}") as caught:
            await robot.send([0.0, value])
        assert (caught.value.code, caught.value.about) == ("invalid_message", "command")
        assert caught.value.seq is not None
        assert (await robot.send([0.0, 0.0])).outcome == "admitted"


async def test_an_unreadable_posted_command_is_reported_at_the_next_tick(connect):
    async with await connect() as cell, await cell.acquire("FR") as robot:
        await first(robot.ticks())
        seq = await robot.post([True])
        await cell.ping()
        with pytest.raises(Refused) as caught:
            await first(robot.ticks())
        assert caught.value.seq == seq


async def test_a_single_number_is_not_an_increment(connect):
    async with await connect() as cell, await cell.acquire("FR") as robot:
        await first(robot.ticks())
        with pytest.raises(BadArgument, match="expected a sequence of numbers, got float"):
            await robot.send(0.1)


# --- leases and stops -------------------------------------------------------------------------------------


async def test_a_refused_acquire_raises(connect, server):
    server.on[m.Acquire] = lambda connection, request: connection.send(error(request, "leased"))
    async with await connect() as cell:
        with pytest.raises(Refused, match="because; wait, or take the robot over") as caught:
            await cell.acquire("FR")
        assert (caught.value.code, caught.value.about) == ("leased", "acquire")


async def test_a_lost_lease_ends_the_loop(connect, server):
    async with await connect() as cell:
        async with await cell.acquire("FR") as robot:
            ticks = aiter(robot.ticks())
            await anext(ticks)
            server.send(state("FR", 1), server.lost("FR", 1, "an operator took the robot over"))
            with pytest.raises(LeaseLost, match=r"took the robot over.*acquire it again") as caught:
                await anext(ticks)
            assert (caught.value.robot, robot.held) == ("FR", False)
            with pytest.raises(LeaseLost):
                await robot.post([0.0, 0.0])
        assert (server.count(m.Release), server.count(m.Command)) == (0, 0)
        async with await cell.acquire("FR") as robot:
            assert robot.held
            assert robot.lease.fence == 2


async def test_the_loss_of_an_old_lease_does_not_affect_a_new_one(connect, server):
    async with await connect() as cell:
        old = await cell.acquire("FR")
        robot = await cell.acquire("FR")
        server.send(
            server.lost("FR", old.lease.fence, "late"), server.lost("GR", robot.lease.fence, "other robot")
        )
        await cell.ping()
        assert (old.held, robot.held) == (False, True)


async def test_a_stop_ends_only_the_loops_of_its_robots(connect, server):
    async with await connect() as cell:
        robot, other = await cell.acquire("FR"), await cell.acquire("GR")
        ticks = aiter(robot.ticks())
        await anext(ticks)
        stopped = m.Stopped(stop=3, robots=("FR",), reason="a person", by="op")
        server.send(stopped, server.lost("FR", 1, "stop 3"))
        with pytest.raises(RobotStopped, match=r"FR was stopped by op \(a person\).*reset stop 3") as caught:
            await anext(ticks)
        assert (caught.value.stop, caught.value.by) == (3, "op")
        assert (robot.held, other.held, list(cell.stops)) == (False, True, [3])
        server.send(m.Resumed(stop=3, by="op"))
        await cell.ping()
        assert list(cell.stops) == []


async def test_an_operator_stops_and_resets(connect):
    async with await connect(role="operator") as cell:
        stopped = await cell.stop("FR", reason="test")
        assert (stopped.stop, stopped.robots, stopped.reason) == (7, ("FR",), "test")
        assert (await cell.reset(stopped.stop)).stop == 7
        assert not cell.stops


async def test_a_lease_is_released_when_the_loop_fails(connect, server):
    async with await connect() as cell:
        with pytest.raises(ZeroDivisionError):
            async with await cell.acquire("FR"):
                1 / 0  # noqa: B018
        await server.received(m.Release)


async def test_a_refused_release_does_not_hide_an_earlier_exception(connect, server):
    server.on[m.Release] = lambda connection, request: connection.send(error(request, "not_held"))
    async with await connect() as cell:
        with pytest.raises(Refused, match="not_held"):
            async with await cell.acquire("FR"):
                pass
        with pytest.raises(ZeroDivisionError):
            async with await cell.acquire("FR"):
                1 / 0  # noqa: B018


async def test_a_reset_connection_is_lost(connect, server):
    async with await connect() as cell, await cell.acquire("FR") as robot:
        await first(robot.ticks())
        sock = server.newest.transport.get_extra_info("socket")
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        server.newest.transport.abort()
        async with asyncio.timeout(10):
            await server.gone.wait()

        async def flood():
            while True:
                await robot.post([0.0, 0.0])

        with pytest.raises(ConnectionLost, match="connect again"):
            await asyncio.wait_for(flood(), 30)


async def test_a_waiting_client_sends_pings(connect, server):
    server.ttl = 0.03
    server.first = None
    async with await connect() as cell, await cell.acquire("FR") as robot:
        waiting = asyncio.ensure_future(first(robot.ticks()))
        await server.received(m.Ping, 3)
        server.send(state("FR", 4))
        assert (await waiting).tick == 4


# --- subscriptions, signals, assets ------------------------------------------------------------------------


async def test_ticks_subscribe_to_one_robot(connect, server):
    async with await connect() as cell, await cell.acquire("FR") as robot:
        await first(robot.ticks())
        request = await server.received(m.Subscribe)
        assert (request.every, request.robots, request.fields) == (1, ("FR",), None)


async def test_ticks_extend_an_existing_subscription(connect, server):
    async with await connect() as cell, await cell.acquire("FR") as robot:
        await cell.subscribe(every=5, robots=["GR"], fields=["q"])
        await first(robot.ticks())
        request = await server.received(m.Subscribe, 2)
        assert (request.every, request.robots, request.fields) == (5, ("GR", "FR"), ("q",))
        await first(cell.states())
        assert server.count(m.Subscribe) == 2


async def test_signals_do_not_wait_for_answers(connect, server):
    async with await connect() as cell:
        await cell.signal("one", 1)
        await cell.signal("three", np.array([1.0, 2.0, 3.0]))
        assert (await server.received(m.Signal, 2)).value == (1.0, 2.0, 3.0)
        with pytest.raises(BadArgument, match="signal bad"):
            await cell.signal("bad", "x")
        with pytest.raises(BadArgument, match="value"):
            await cell.signal("bad", [])


async def test_a_delayed_signal_is_sent_with_the_next_message(connect, server):
    async with await connect() as cell:
        await cell.signal("one", 1, more=True)
        await cell.signal("two", 2, more=True)
        await asyncio.sleep(0)
        assert server.count(m.Signal) == 0
        await cell.ping()
        assert (await server.received(m.Signal, 2)).name == "two"
        assert server.count(m.Signal) == 2
        await cell.signal("three", 3, more=True)
    assert (await server.received(m.Signal, 3)).name == "three"  # a bye also sends delayed signals


async def test_a_participant_without_a_robot_passes_the_step_of_the_newest_state(connect, server):
    server.lockstep = True
    server.first = state("FR", 0, step=5)
    async with await connect() as cell:
        await cell.skip()  # no state has arrived yet
        assert (await first(cell.states())).step == 5
        await cell.skip()
        assert (await server.received(m.Pass)).step == 5
        assert server.count(m.Pass) == 1


async def test_the_refusal_of_a_signal_is_raised_by_the_next_one(connect, server):
    server.on[m.Signal] = lambda connection, request: connection.send(error(request, "signal_owned"))
    async with await connect() as cell:
        await cell.signal("zoom", 1.0)
        await cell.ping()
        with pytest.raises(Refused, match="signal_owned"):
            await cell.signal("zoom", 1.0)


async def test_signals_that_arrive_too_fast_are_only_counted(connect, server):
    server.on[m.Signal] = lambda connection, request: connection.send(error(request, "signal_rate"))
    async with await connect() as cell:
        for _ in range(3):
            await cell.signal("zoom", 1.0)
        await cell.ping()
        assert cell.signals_dropped == 3


async def test_an_asset_is_downloaded_once_in_pieces(connect, server):
    async with await connect() as cell:
        assert (await cell.urdf("GR")).encode() == URDF
        assert await cell.asset(URDF_HASH) == URDF
        assert server.count(m.Asset) == 3
        with pytest.raises(BadArgument, match="no robot XX; the cell has FR, GR"):
            await cell.urdf("XX")


@pytest.mark.parametrize(("data", "error"), [(b"abc", "another hash"), (b"", "not requested")])
async def test_an_asset_with_another_hash_and_an_empty_piece_are_refused(connect, server, data, error):
    server.on[m.Asset] = lambda connection, request: connection.send(
        m.Chunk(re=request.id, hash=request.hash, offset=0, total=3, data=data)
    )
    async with await connect() as cell:
        with pytest.raises(ConnectionLost, match=error):
            await cell.asset(URDF_HASH)


# --- lock-step --------------------------------------------------------------------------------------------


async def test_skip_passes_the_step(connect, server):
    server.lockstep = True
    server.first = state("FR", 0, step=11)
    async with await connect() as cell, await cell.acquire("FR") as robot:
        ticks = aiter(robot.ticks())
        assert (await anext(ticks)).step == 11
        await robot.skip()
        assert (await server.received(m.Pass)).step == 11


async def test_skip_sends_nothing_by_the_wall_clock(connect, server):
    async with await connect() as cell, await cell.acquire("FR") as robot:
        await first(robot.ticks())
        await robot.skip()
        await cell.ping()
        assert server.count(m.Pass) == 0


async def test_a_wait_in_lock_step_is_unlimited_while_the_server_answers(connect, server):
    server.lockstep, server.ttl = True, 0.03
    server.on[m.Command] = lambda connection, command: None
    async with await connect(timeout=0.1, patience=0.05) as cell, await cell.acquire("FR") as robot:
        await first(robot.ticks())
        sending = asyncio.ensure_future(robot.send([0.0, 0.0]))
        await server.received(m.Ping, 20)
        server.send(verdict(await server.received(m.Command)))
        assert (await sending).outcome == "admitted"


async def test_a_silent_server_is_detected(connect, server):
    server.lockstep, server.ttl = True, 0.03
    server.first = None
    async with await connect(timeout=0.1) as cell:
        server.on[m.Ping] = lambda connection, request: None
        with pytest.raises(TimedOut, match=r"silent for 0.1 s"):
            await first(cell.states())


# --- failures ---------------------------------------------------------------------------------------------


async def test_a_late_answer_is_dropped(connect, server):
    async with await connect(timeout=0.05) as cell:
        server.on[m.Stop] = lambda connection, request: None
        with pytest.raises(TimedOut, match=r"an answer to stop did not arrive within 0.05 s"):
            await cell.stop()
        server.send(
            m.Stopped(re=(await server.received(m.Stop)).id, stop=1, robots=("FR",), reason="", by="c")
        )
        assert await cell.ping() >= 0.0
        assert list(cell.stops) == [1]


async def test_a_missing_tick_times_out(connect, server):
    server.first = None
    async with await connect(patience=0.05) as cell, await cell.acquire("FR") as robot:
        with pytest.raises(TimedOut, match=r"a tick of FR did not arrive within 0.05 s"):
            await first(robot.ticks())
        with pytest.raises(TimedOut, match=r"0.01 s"):
            await first(robot.ticks(timeout=0.01))


async def test_messages_before_the_end_are_still_returned(connect, server):
    def final_messages(connection, command):
        connection.send(verdict(command), m.Bye(reason="shutting down"))
        connection.transport.close()

    server.on[m.Command] = final_messages
    async with await connect() as cell, await cell.acquire("FR") as robot:
        await first(robot.ticks())
        assert (await robot.send([0.0, 0.0])).outcome == "admitted"
        with pytest.raises(ConnectionLost, match=r"ended the connection \(shutting down\)"):
            await first(robot.ticks())


async def test_a_fatal_error_ends_the_connection(connect, server):
    async with await connect() as cell, await cell.acquire("FR") as robot:
        await first(robot.ticks())
        server.on[m.Command] = lambda connection, command: connection.send(
            error(command, "overflow", fatal=True)
        )
        with pytest.raises(Rejected, match="overflow: because; read faster"):
            await robot.send([0.0, 0.0])
        with pytest.raises(Rejected):
            await cell.ping()


async def test_a_lost_server_is_reported(connect, server):
    async with await connect() as cell, await cell.acquire("FR") as robot:
        await first(robot.ticks())
        server.on[m.Command] = lambda connection, command: connection.transport.abort()
        with pytest.raises(ConnectionLost, match="connect again"):
            await robot.send([0.0, 0.0])


@pytest.mark.parametrize("bytes_", [b"\xff" * 8, frame(b"\xc1"), frame(b"\x81\xa4type\xa7verdict")])
async def test_garbage_from_the_server_ends_the_connection(connect, server, bytes_):
    async with await connect() as cell:
        server.on[m.Ping] = lambda connection, request: connection.transport.write(bytes_)
        with pytest.raises(ConnectionLost, match=r"an unreadable message.*versions"):
            await cell.ping()


async def test_messages_of_a_later_version_are_ignored(connect, server):
    async with await connect() as cell:
        server.newest.transport.write(frame(b"\x81\xa4type\xa7weather"))
        assert await cell.ping() >= 0.0


async def test_a_server_that_does_not_read_ends_the_connection(connect, server):
    async with await connect(timeout=0.05) as cell, await cell.acquire("FR") as robot:
        await first(robot.ticks())
        server.newest.transport.pause_reading()

        async def flood():
            while True:
                await robot.post([0.0] * 64)

        with pytest.raises(ConnectionLost, match="read nothing for"):
            await asyncio.wait_for(flood(), 30)


async def test_a_closed_connection_stays_closed(connect, server):
    cell = await connect()
    await cell.close()
    await cell.close()
    with pytest.raises(ConnectionLost, match="this client has closed"):
        await cell.ping()
    async with asyncio.timeout(10):
        await server.gone.wait()


async def test_two_tasks_share_a_connection(server):
    async with await aio.connect(server.address, "c") as cell:
        robot, other = await asyncio.gather(cell.acquire("FR"), cell.acquire("GR"))
        server.send(state("FR", 1), state("GR", 1))

        async def drive(handle):
            ticks = aiter(handle.ticks())
            await anext(ticks)
            return await asyncio.gather(*(handle.send([0.0, 0.0]) for _ in range(5)))

        verdicts = await asyncio.gather(drive(robot), drive(other))
        assert [{answer.robot for answer in each} for each in verdicts] == [{"FR"}, {"GR"}]
        assert len({answer.seq for each in verdicts for answer in each}) == 10


@pytest.mark.parametrize("kind", ["Cell", "Robot"])
def test_both_shells_have_the_same_names_and_parameters(kind):
    def interface(cls):
        found = inspect.getmembers(cls, lambda x: callable(x) or isinstance(x, property))
        return {
            name: list(inspect.signature(value).parameters) if callable(value) else property
            for name, value in found
            if not name.startswith("_")
        }

    assert interface(getattr(aio, kind)) == interface(getattr(blocking, kind))
    assert (
        inspect.signature(aio.connect).parameters.keys()
        == inspect.signature(blocking.connect).parameters.keys()
    )
