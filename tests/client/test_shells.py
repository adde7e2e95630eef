"""Both shells against a server on loopback: every test runs for asyncio and for plain sockets."""

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
from support.wire import ROBOTS, URDF, URDF_HASH, state, verdict


async def first(items):
    return await anext(aiter(items))


def error(request, code, fatal=False, **more):
    return m.Error(
        re=getattr(request, "id", None), code=code, text="because", fatal=fatal, about=request.type, **more
    )


# --- connecting -------------------------------------------------------------------------------------------


async def test_connect_says_hello_and_asks_for_the_description(connect, server):
    async with await connect(role="observer", token="secret") as cell:
        hello = await server.said(m.Hello)
        assert (hello.name, hello.role, hello.token, hello.versions) == ("c", "observer", "secret", (1,))
        assert cell.welcome.session == "session"
        assert [robot.name for robot in cell.description.robots] == list(ROBOTS)
    await server.said(m.Bye)


async def test_nobody_listens(connect, server):
    server.listening.close()
    await server.listening.wait_closed()
    with pytest.raises(ConnectionLost, match=r"no connection to 127\.0\.0\.1:\d+.*armgate serve"):
        await connect()


async def test_bad_arguments_are_named_before_anything_is_sent(connect, server):
    with pytest.raises(BadArgument, match="no port"):
        await connect(address="localhost")
    with pytest.raises(BadArgument, match="name"):
        await connect(name="two words")
    assert server.heard == []


async def test_a_server_without_a_common_version_ends_the_connection(connect, server):
    text = "no version in common: the server speaks [2], the client [1]"
    server.on[m.Hello] = lambda seat, hello: seat.say(m.Error(code="version", text=text, fatal=True))
    with pytest.raises(Rejected, match=r"speaks \[2\], the client \[1\]") as caught:
        await connect()
    assert caught.value.code == "version"


async def test_a_server_that_never_welcomes(connect, server):
    server.on[m.Hello] = lambda seat, hello: None
    with pytest.raises(TimedOut, match="a welcome did not come within"):
        await connect(timeout=0.05)


# --- the ten lines ----------------------------------------------------------------------------------------


async def test_a_controller(connect, server):
    async with await connect() as cell:
        async with await cell.acquire("FR", speed=0.5) as robot:
            assert (robot.lease.fence, robot.lease.speed) == (1, 0.5)
            tick = await first(robot.ticks())
            assert (tick.tick, tick.q, tick.setpoint) == (0, (0.1, 0.2), (0.3, 0.4))
            assert tick.entry("GR").robot == "GR"
            judged = await robot.send([0.001, -0.002])
            assert judged.outcome == "admitted"
        command = await server.said(m.Command)
        assert (command.robot, command.fence, command.tick, command.dq) == ("FR", 1, 0, (0.001, -0.002))
        assert judged.seq == command.seq
        release = await server.said(m.Release)
        assert (release.robot, release.fence) == ("FR", 1)
    await server.said(m.Bye)


async def test_the_newest_tick_wins(connect, server):
    async with await connect() as cell, await cell.acquire("FR") as robot:
        ticks = aiter(robot.ticks())
        assert (await anext(ticks)).tick == 0
        server.say(*(state("FR", tick) for tick in range(1, 60)), state("GR", 99))
        assert (await anext(ticks)).tick == 59


async def test_a_tick_that_is_known_gives_way_to_a_newer_one_that_is_not_read_yet(connect, server):
    async with await connect() as cell, await cell.acquire("FR") as robot:
        ticks = aiter(robot.ticks())
        await anext(ticks)
        server.say(state("FR", 1))
        await cell.ping()
        server.say(state("FR", 2), state("FR", 3))
        assert (await anext(ticks)).tick == 3


async def test_states_are_the_newest_of_any_robot(connect, server):
    async with await connect(role="observer") as cell:
        states = aiter(cell.states())
        assert (await anext(states)).tick == 0
        assert (await server.said(m.Subscribe)).robots is None
        server.say(state("FR", 1), state("GR", 5))
        newest = await anext(states)
        assert (newest.robot, newest.tick) == ("GR", 5)
        assert cell.state == newest


async def test_verdicts_of_posts_are_all_kept_in_order(connect, server):
    async with await connect() as cell, await cell.acquire("FR") as robot:
        await first(robot.ticks())
        sent = [await robot.post([0.0, 0.0]) for _ in range(20)]
        await robot.send([0.0, 0.0])
        assert [judged.seq for judged in robot.verdicts()] == sent
        assert robot.verdicts() == []


async def test_the_command_names_the_tick_last_yielded(connect, server):
    async with await connect() as cell, await cell.acquire("FR") as robot:
        await first(robot.ticks())
        server.say(state("FR", 1), state("FR", 2))
        await cell.ping()
        await robot.send([0.0, 0.0])
        assert (await server.said(m.Command)).tick == 0


async def test_commands_need_a_tick(connect, server):
    async with await connect() as cell, await cell.acquire("FR") as robot:
        with pytest.raises(BadArgument, match=r"robot\.ticks\(\)"):
            await robot.send([0.0, 0.0])


@pytest.mark.parametrize(
    "dq", [np.array([0.25, 0.5]), [np.float32(0.25), np.float64(0.5)], (0.25, 0.5), [0.25, 0.5]]
)
async def test_any_sequence_of_numbers_is_an_increment(connect, server, dq):
    async with await connect() as cell, await cell.acquire("FR") as robot:
        await first(robot.ticks())
        await robot.send(dq)
        assert (await server.said(m.Command)).dq == (0.25, 0.5)


async def test_an_increment_that_is_not_finite_is_for_the_server_to_judge(connect, server):
    server.on[m.Command] = lambda seat, command: seat.say(
        verdict(command, outcome="refused", beta=0.0, reasons=(m.Reason(cause="not_finite", text="nan"),))
    )
    async with await connect() as cell, await cell.acquire("FR") as robot:
        await first(robot.ticks())
        judged = await robot.send([math.nan, math.inf])
        assert (judged.outcome, judged.reasons[0].cause) == ("refused", "not_finite")
        assert math.isnan((await server.said(m.Command)).dq[0])


@pytest.mark.parametrize(("value", "told"), [(True, "a bool True"), ("x", "a text 'x'"), (None, "nil")])
async def test_what_cannot_be_read_has_no_verdict(connect, server, value, told):
    async with await connect() as cell, await cell.acquire("FR") as robot:
        await first(robot.ticks())
        with pytest.raises(Refused, match=rf"command\.dq\[1\].*{told}") as caught:
            await robot.send([0.0, value])
        assert (caught.value.code, caught.value.about) == ("invalid_message", "command")
        assert caught.value.seq is not None
        assert (await robot.send([0.0, 0.0])).outcome == "admitted"


async def test_what_was_posted_and_cannot_be_read_is_told_at_the_next_tick(connect, server):
    async with await connect() as cell, await cell.acquire("FR") as robot:
        await first(robot.ticks())
        seq = await robot.post([True])
        await cell.ping()
        with pytest.raises(Refused) as caught:
            await first(robot.ticks())
        assert caught.value.seq == seq


async def test_a_number_is_no_increment(connect, server):
    async with await connect() as cell, await cell.acquire("FR") as robot:
        await first(robot.ticks())
        with pytest.raises(BadArgument, match="expected a sequence of numbers, got float"):
            await robot.send(0.1)


# --- leases and stops -------------------------------------------------------------------------------------


async def test_acquiring_may_be_refused(connect, server):
    server.on[m.Acquire] = lambda seat, request: seat.say(error(request, "leased"))
    async with await connect() as cell:
        with pytest.raises(Refused, match="because; wait, or take it over") as caught:
            await cell.acquire("FR")
        assert (caught.value.code, caught.value.about) == ("leased", "acquire")


async def test_a_lost_lease_ends_the_loop(connect, server):
    async with await connect() as cell:
        async with await cell.acquire("FR") as robot:
            ticks = aiter(robot.ticks())
            await anext(ticks)
            server.say(state("FR", 1), server.lost("FR", 1, "an operator took it over"))
            with pytest.raises(LeaseLost, match=r"took it over.*acquire it again") as caught:
                await anext(ticks)
            assert (caught.value.robot, robot.held) == ("FR", False)
            with pytest.raises(LeaseLost):
                await robot.post([0.0, 0.0])
        assert (server.count(m.Release), server.count(m.Command)) == (0, 0)
        async with await cell.acquire("FR") as robot:
            assert robot.held
            assert robot.lease.fence == 2


async def test_an_old_loss_does_not_touch_a_new_lease(connect, server):
    async with await connect() as cell:
        old = await cell.acquire("FR")
        robot = await cell.acquire("FR")
        server.say(
            server.lost("FR", old.lease.fence, "late"), server.lost("GR", robot.lease.fence, "other robot")
        )
        await cell.ping()
        assert (old.held, robot.held) == (False, True)


async def test_a_stop_ends_the_loop_of_its_robots_alone(connect, server):
    async with await connect() as cell:
        robot, other = await cell.acquire("FR"), await cell.acquire("GR")
        ticks = aiter(robot.ticks())
        await anext(ticks)
        stopped = m.Stopped(stop=3, robots=("FR",), reason="a person", by="op")
        server.say(stopped, server.lost("FR", 1, "stop 3"))
        with pytest.raises(RobotStopped, match=r"FR was stopped by op \(a person\).*reset stop 3") as caught:
            await anext(ticks)
        assert (caught.value.stop, caught.value.by) == (3, "op")
        assert (robot.held, other.held, list(cell.stops)) == (False, True, [3])
        server.say(m.Resumed(stop=3, by="op"))
        await cell.ping()
        assert list(cell.stops) == []


async def test_stop_and_reset(connect, server):
    async with await connect(role="operator") as cell:
        stopped = await cell.stop("FR", reason="test")
        assert (stopped.stop, stopped.robots, stopped.reason) == (7, ("FR",), "test")
        assert (await cell.reset(stopped.stop)).stop == 7
        assert not cell.stops


async def test_a_lease_is_given_back_when_the_loop_fails(connect, server):
    async with await connect() as cell:
        with pytest.raises(ZeroDivisionError):
            async with await cell.acquire("FR"):
                1 / 0  # noqa: B018
        await server.said(m.Release)


async def test_a_release_that_is_refused_does_not_hide_what_went_wrong_before(connect, server):
    server.on[m.Release] = lambda seat, request: seat.say(error(request, "not_held"))
    async with await connect() as cell:
        with pytest.raises(Refused, match="not_held"):
            async with await cell.acquire("FR"):
                pass
        with pytest.raises(ZeroDivisionError):
            async with await cell.acquire("FR"):
                1 / 0  # noqa: B018


async def test_a_connection_that_is_reset(connect, server):
    async with await connect() as cell, await cell.acquire("FR") as robot:
        await first(robot.ticks())
        sock = server.seat.transport.get_extra_info("socket")
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        server.seat.transport.abort()
        async with asyncio.timeout(10):
            await server.gone.wait()

        async def flood():
            while True:
                await robot.post([0.0, 0.0])

        with pytest.raises(ConnectionLost, match="connect again"):
            await asyncio.wait_for(flood(), 30)


async def test_waiting_keeps_the_lease(connect, server):
    server.ttl = 0.03
    server.first = None
    async with await connect() as cell, await cell.acquire("FR") as robot:
        waiting = asyncio.ensure_future(first(robot.ticks()))
        await server.said(m.Ping, 3)
        server.say(state("FR", 4))
        assert (await waiting).tick == 4


# --- subscriptions, signals, assets ------------------------------------------------------------------------


async def test_following_a_robot_asks_for_its_ticks_alone(connect, server):
    async with await connect() as cell, await cell.acquire("FR") as robot:
        await first(robot.ticks())
        asked = await server.said(m.Subscribe)
        assert (asked.every, asked.robots, asked.fields) == (1, ("FR",), None)


async def test_a_subscription_of_ones_own_is_kept_and_widened(connect, server):
    async with await connect() as cell, await cell.acquire("FR") as robot:
        await cell.subscribe(every=5, robots=["GR"], fields=["q"])
        await first(robot.ticks())
        asked = await server.said(m.Subscribe, 2)
        assert (asked.every, asked.robots, asked.fields) == (5, ("GR", "FR"), ("q",))
        await first(cell.states())
        assert server.count(m.Subscribe) == 2


async def test_signals_do_not_wait(connect, server):
    async with await connect() as cell:
        await cell.signal("one", 1)
        await cell.signal("three", np.array([1.0, 2.0, 3.0]))
        assert (await server.said(m.Signal, 2)).value == (1.0, 2.0, 3.0)
        with pytest.raises(BadArgument, match="signal bad"):
            await cell.signal("bad", "x")
        with pytest.raises(BadArgument, match="value"):
            await cell.signal("bad", [])


async def test_a_signal_with_more_to_come_goes_with_what_is_said_next(connect, server):
    async with await connect() as cell:
        await cell.signal("one", 1, more=True)
        await cell.signal("two", 2, more=True)
        await asyncio.sleep(0)
        assert server.count(m.Signal) == 0
        await cell.ping()
        assert (await server.said(m.Signal, 2)).name == "two"
        assert server.count(m.Signal) == 2
        await cell.signal("three", 3, more=True)
    assert (await server.said(m.Signal, 3)).name == "three"  # a bye takes it along, too


async def test_a_robot_less_participant_passes_the_step_of_the_newest_state(connect, server):
    server.lockstep = True
    server.first = state("FR", 0, step=5)
    async with await connect() as cell:
        await cell.skip()  # nothing has been seen yet
        assert (await first(cell.states())).step == 5
        await cell.skip()
        assert (await server.said(m.Pass)).step == 5
        assert server.count(m.Pass) == 1


async def test_the_refusal_of_a_signal_is_told_by_the_next_one(connect, server):
    server.on[m.Signal] = lambda seat, request: seat.say(error(request, "signal_owned"))
    async with await connect() as cell:
        await cell.signal("zoom", 1.0)
        await cell.ping()
        with pytest.raises(Refused, match="signal_owned"):
            await cell.signal("zoom", 1.0)


async def test_a_signal_that_came_too_fast_is_only_counted(connect, server):
    server.on[m.Signal] = lambda seat, request: seat.say(error(request, "signal_rate"))
    async with await connect() as cell:
        for _ in range(3):
            await cell.signal("zoom", 1.0)
        await cell.ping()
        assert cell.signals_dropped == 3


async def test_an_asset_is_fetched_once_in_pieces(connect, server):
    async with await connect() as cell:
        assert (await cell.urdf("GR")).encode() == URDF
        assert await cell.asset(URDF_HASH) == URDF
        assert server.count(m.Asset) == 3
        with pytest.raises(BadArgument, match="no robot XX; the cell has FR, GR"):
            await cell.urdf("XX")


async def test_an_asset_with_another_hash_is_not_taken(connect, server):
    server.on[m.Asset] = lambda seat, request: seat.say(
        m.Chunk(re=request.id, hash=request.hash, offset=0, total=3, data=b"abc")
    )
    async with await connect() as cell:
        with pytest.raises(ConnectionLost, match="another hash"):
            await cell.asset(URDF_HASH)


async def test_an_asset_that_does_not_grow_ends(connect, server):
    server.on[m.Asset] = lambda seat, request: seat.say(
        m.Chunk(re=request.id, hash=request.hash, offset=0, total=3, data=b"")
    )
    async with await connect() as cell:
        with pytest.raises(ConnectionLost, match="not asked for"):
            await cell.asset(URDF_HASH)


# --- lock-step --------------------------------------------------------------------------------------------


async def test_skip_passes_the_step(connect, server):
    server.lockstep = True
    server.first = state("FR", 0, step=11)
    async with await connect() as cell, await cell.acquire("FR") as robot:
        ticks = aiter(robot.ticks())
        assert (await anext(ticks)).step == 11
        await robot.skip()
        assert (await server.said(m.Pass)).step == 11


async def test_skip_says_nothing_by_the_wall_clock(connect, server):
    async with await connect() as cell, await cell.acquire("FR") as robot:
        await first(robot.ticks())
        await robot.skip()
        await cell.ping()
        assert server.count(m.Pass) == 0


async def test_lockstep_waits_as_long_as_the_server_lives(connect, server):
    server.lockstep, server.ttl = True, 0.03
    server.on[m.Command] = lambda seat, command: None
    async with await connect(timeout=0.1, patience=0.05) as cell, await cell.acquire("FR") as robot:
        await first(robot.ticks())
        sending = asyncio.ensure_future(robot.send([0.0, 0.0]))
        await server.said(m.Ping, 20)
        server.say(verdict(await server.said(m.Command)))
        assert (await sending).outcome == "admitted"


async def test_a_silent_server_is_found_out(connect, server):
    server.lockstep, server.ttl = True, 0.03
    server.first = None
    async with await connect(timeout=0.1) as cell:
        server.on[m.Ping] = lambda seat, request: None
        with pytest.raises(TimedOut, match=r"silent for 0.1 s"):
            await first(cell.states())


# --- what goes wrong --------------------------------------------------------------------------------------


async def test_an_answer_that_comes_late_is_dropped(connect, server):
    async with await connect(timeout=0.05) as cell:
        server.on[m.Stop] = lambda seat, request: None
        with pytest.raises(TimedOut, match=r"an answer to stop did not come within 0.05 s"):
            await cell.stop()
        server.say(m.Stopped(re=(await server.said(m.Stop)).id, stop=1, robots=("FR",), reason="", by="c"))
        assert await cell.ping() >= 0.0
        assert list(cell.stops) == [1]


async def test_no_tick_within_the_patience(connect, server):
    server.first = None
    async with await connect(patience=0.05) as cell, await cell.acquire("FR") as robot:
        with pytest.raises(TimedOut, match=r"a tick of FR did not come within 0.05 s"):
            await first(robot.ticks())
        with pytest.raises(TimedOut, match=r"0.01 s"):
            await first(robot.ticks(timeout=0.01))


async def test_what_came_before_the_end_is_still_given(connect, server):
    def last_word(seat, command):
        seat.say(verdict(command), m.Bye(reason="shutting down"))
        seat.transport.close()

    server.on[m.Command] = last_word
    async with await connect() as cell, await cell.acquire("FR") as robot:
        await first(robot.ticks())
        assert (await robot.send([0.0, 0.0])).outcome == "admitted"
        with pytest.raises(ConnectionLost, match=r"said goodbye \(shutting down\)"):
            await first(robot.ticks())


async def test_a_fatal_error_ends_the_connection(connect, server):
    async with await connect() as cell, await cell.acquire("FR") as robot:
        await first(robot.ticks())
        server.on[m.Command] = lambda seat, command: seat.say(error(command, "overflow", fatal=True))
        with pytest.raises(Rejected, match="overflow: because; read faster"):
            await robot.send([0.0, 0.0])
        with pytest.raises(Rejected):
            await cell.ping()


async def test_the_server_is_gone(connect, server):
    async with await connect() as cell, await cell.acquire("FR") as robot:
        await first(robot.ticks())
        server.on[m.Command] = lambda seat, command: seat.transport.abort()
        with pytest.raises(ConnectionLost, match="connect again"):
            await robot.send([0.0, 0.0])


@pytest.mark.parametrize("bytes_", [b"\xff" * 8, frame(b"\xc1"), frame(b"\x81\xa4type\xa7verdict")])
async def test_a_server_that_sends_garbage(connect, server, bytes_):
    async with await connect() as cell:
        server.on[m.Ping] = lambda seat, request: seat.transport.write(bytes_)
        with pytest.raises(ConnectionLost, match=r"what cannot be read.*versions"):
            await cell.ping()


async def test_messages_of_a_later_version_are_left_out(connect, server):
    async with await connect() as cell:
        server.seat.transport.write(frame(b"\x81\xa4type\xa7weather"))
        assert await cell.ping() >= 0.0


async def test_a_server_that_does_not_read(connect, server):
    async with await connect(timeout=0.05) as cell, await cell.acquire("FR") as robot:
        await first(robot.ticks())
        server.seat.transport.pause_reading()

        async def flood():
            while True:
                await robot.post([0.0] * 64)

        with pytest.raises(ConnectionLost, match="read nothing for"):
            await asyncio.wait_for(flood(), 30)


async def test_closed_is_closed(connect, server):
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
        server.say(state("FR", 1), state("GR", 1))

        async def drive(handle):
            ticks = aiter(handle.ticks())
            await anext(ticks)
            return await asyncio.gather(*(handle.send([0.0, 0.0]) for _ in range(5)))

        verdicts = await asyncio.gather(drive(robot), drive(other))
        assert [{judged.robot for judged in each} for each in verdicts] == [{"FR"}, {"GR"}]
        assert len({judged.seq for each in verdicts for judged in each}) == 10


@pytest.mark.parametrize("kind", ["Cell", "Robot"])
def test_both_shells_have_the_same_names_and_parameters(kind):
    def face(cls):
        found = inspect.getmembers(cls, lambda x: callable(x) or isinstance(x, property))
        return {
            name: list(inspect.signature(value).parameters) if callable(value) else property
            for name, value in found
            if not name.startswith("_")
        }

    assert face(getattr(aio, kind)) == face(getattr(blocking, kind))
    assert (
        inspect.signature(aio.connect).parameters.keys()
        == inspect.signature(blocking.connect).parameters.keys()
    )
