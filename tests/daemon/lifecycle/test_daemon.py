"""Start, failures and end of a daemon, in the event loop of the test."""

import asyncio
import io
import json

import msgpack
import pytest

from armgate import events
from armgate.cell.cell import build_cell
from armgate.daemon.auth.keys import Keys
from armgate.daemon.auth.tokens import Tokens
from armgate.daemon.lifecycle.daemon import Daemon
from armgate.daemon.lifecycle.phase import TRANSITIONS, Lifetime, Phase, PhaseEvent
from armgate.daemon.sessions.connection_limits import ConnectionLimits
from armgate.gate import Gate
from armgate.links.log import Log
from armgate.protocol import messages as m
from armgate.protocol.framing import frame
from support.cells import arms_config
from support.clients import PATIENCE, Mover, Raw


class Broken:
    """A gate that fails at one kind of event after the test has set ``at``."""

    def __init__(self, cell, start):
        self.gate = Gate(cell, start)
        self.at = None
        self.asked_after = 0
        self.has_failed = False

    def step(self, event):
        if self.has_failed:
            self.asked_after += 1
        if self.at is not None and isinstance(event, self.at):
            self.has_failed = True
            raise ZeroDivisionError("a defect")
        return self.gate.step(event)

    def view(self, robot):
        return self.gate.view(robot)

    def warnings(self):
        return ()


class Running:
    """A running daemon with its log."""

    def __init__(self, config, make=Gate, keys=None):
        self.log = io.StringIO()
        self.writer = Log(self.log)
        self.cell = build_cell(config)
        self.made = []
        self.daemon = Daemon(
            self.cell, lambda *a: self.made.append(make(*a)) or self.made[-1], self.writer, keys
        )

    async def __aenter__(self):
        port = asyncio.get_running_loop().create_future()
        self.task = asyncio.create_task(self.daemon.run(lambda host, number: port.set_result(number)))
        await asyncio.wait([port, self.task], return_when=asyncio.FIRST_COMPLETED, timeout=PATIENCE)
        self.port = port.result() if port.done() else self.task.result()
        return self

    async def __aexit__(self, *_):
        await Raw.close_all()
        while not self.task.done():
            self.daemon.end()
            await asyncio.wait([self.task], timeout=PATIENCE)
        self.writer.close()

    async def status(self):
        status = await asyncio.wait_for(asyncio.shield(self.task), PATIENCE)
        self.writer.close()
        return status

    @property
    def lines(self):
        return [json.loads(line) for line in self.log.getvalue().splitlines()]

    def logged(self, event):
        return [line for line in self.lines if line["event"] == event]

    @property
    def link(self):
        return self.daemon._ticking._links[0]


def config_of(tmp_path, **more):
    server = {"port": 0, "handshake_timeout": 5.0} | more.pop("server", {})
    body = ", ".join(f"{key}: {value}" for key, value in server.items())
    return arms_config(tmp_path, server=f"{{{body}}}", **more)


def test_over_is_the_last_phase_and_every_other_phase_can_end():
    for phase in Phase:
        events = {event for event in PhaseEvent if (phase, event) in TRANSITIONS}
        assert (PhaseEvent.END in events) == (phase is not Phase.OVER)
    life = Lifetime()
    assert not life.advance(PhaseEvent.REST)
    assert [life.advance(event) for event in (PhaseEvent.FAIL, PhaseEvent.FAIL, PhaseEvent.REST)] == [
        True, False, True,
    ]  # fmt: skip
    assert (life.phase, life.advance(PhaseEvent.END)) == (Phase.OVER, False)


async def test_a_signal_stops_the_robots_and_ends_the_daemon_with_bye_when_they_are_at_rest(tmp_path):
    async with Running(config_of(tmp_path, lag=0.03)) as running:
        mover = await Mover.start(running.port, "A")
        await mover.moves_on(10)
        await mover.stop()
        eye = await Raw.hello(running.port, "eye", "observer")
        eye.send(m.Subscribe(robots=("A",)))
        await eye.get(m.State)
        running.daemon.end()
        told = await eye.rest()
        assert await running.status() == 0
        assert isinstance(told[-1], m.Bye)
        assert [x.by for x in told if isinstance(x, m.Stopped)] == ["daemon"]
        last = [x for x in told if isinstance(x, m.State)][-1].entries[0]
        assert last.q == pytest.approx(last.setpoint, abs=1e-3)
        assert last.holder is None
        assert running.link.remaining == 0


async def test_a_second_signal_ends_the_daemon_at_once(tmp_path):
    async with Running(config_of(tmp_path)) as running:
        running.daemon.end()
        running.daemon.end()
        assert await running.status() == 1
        assert running.logged("end.at_once")


@pytest.mark.parametrize("event", [events.Command, events.Tick, events.LeaseChange, events.PlanAnswer])
async def test_if_the_gate_fails_the_robots_come_to_rest_and_it_gets_no_further_event(tmp_path, event):
    async with Running(config_of(tmp_path), Broken) as running:
        mover = await Mover.start(running.port, "A")
        eye = await Raw.hello(running.port, "eye", "observer")
        await mover.moves_on(10)
        running.made[0].at = event
        if event is events.LeaseChange:
            mover.raw.send(m.Release(robot="A", fence=mover.fence))
        await mover.ended()
        assert await running.status() == 1
        assert running.made[0].asked_after == 0
        assert running.link.remaining == 0
        assert running.link._setpoint == running.link._robot.q
        (line,) = running.logged("failed")
        assert "a defect" in line["error"]
        assert "Traceback" in line["traceback"]
        assert running.logged("at_rest")
        error = next(x for x in await eye.rest() if isinstance(x, m.Error))
        assert (error.code, error.fatal) == ("internal", True)


async def test_a_gate_that_fails_at_the_first_tick_ends_the_daemon(tmp_path):
    class Dead(Broken):
        def __init__(self, cell, start):
            super().__init__(cell, start)
            self.at = events.Tick

    async with Running(config_of(tmp_path), Dead) as running:
        assert await running.status() == 1
    async with Running(config_of(tmp_path, clock="{kind: lockstep, participants: [a]}"), Dead) as running:
        assert await running.status() == 1


async def test_the_robots_come_to_rest_after_the_gate_fails_in_lockstep_too(tmp_path):
    config = config_of(tmp_path, clock="{kind: lockstep, participants: [mover]}")
    async with Running(config, Broken) as running:
        mover = await Mover.start(running.port, "A")
        await mover.moves_on(10)
        running.made[0].at = events.Command
        await mover.ended()
        assert await running.status() == 1
        assert running.made[0].asked_after == 0
        assert running.link.remaining == 0


@pytest.mark.slow
async def test_in_lockstep_the_daemon_ends_without_waiting_for_participants(tmp_path):
    config = config_of(tmp_path, clock="{kind: lockstep, participants: [mover, other]}")
    async with Running(config) as running:
        other = await Raw.hello(running.port, "other")
        running.daemon.end()
        assert await running.status() == 0
        assert isinstance((await other.rest())[-1], m.Bye)


@pytest.mark.slow
async def test_a_dropped_participant_fails_the_run(tmp_path):
    config = config_of(tmp_path, clock="{kind: lockstep, participants: [a, b], grace: 0.2}")
    async with Running(config) as running:
        a = await Raw.hello(running.port, "a")
        b = await Raw.hello(running.port, "b")
        b.send(m.Subscribe(robots=("A",)), m.Pass(step=0))
        errors = [x for x in await a.rest() if isinstance(x, m.Error)]
        assert [(e.code, e.fatal) for e in errors] == [("silent", True)]
        state = await b.get(m.State, lambda s: s.step == 1)
        assert state.tick == 1
        b.send(m.Pass(step=1))
        state = await b.get(m.State, lambda s: s.step == 2)
        assert "dropped" in state.warnings[0]
        running.daemon.end()
        assert await running.status() == 1
        assert running.logged("lockstep.dropped")


async def test_connections_are_bounded_and_a_closed_one_frees_its_place(tmp_path):
    async with Running(config_of(tmp_path, server={"max_connections": 2})) as running:
        await Raw.hello(running.port, "a")
        second = await Raw.hello(running.port, "b")
        third = await Raw.open(running.port)
        (error,) = await third.rest()
        assert (error.code, error.fatal) == ("too_many", True)
        second.send(m.Bye())
        await second.rest()
        await second.close()
        async with asyncio.timeout(PATIENCE):
            while True:
                again = await Raw.open(running.port)
                again.send(m.Hello(versions=(1,), name="c"))
                answer = await again.next()
                if isinstance(answer, m.Welcome):
                    break


async def test_half_open_connections_are_closed_in_time(tmp_path):
    async with Running(config_of(tmp_path, server={"handshake_timeout": 0.1})) as running:
        silent = [await Raw.open(running.port) for _ in range(5)]
        silent[0].send_bytes(b"\x00")
        for wire in silent:
            (error,) = await wire.rest()
            assert (error.code, error.fatal) == ("handshake_timeout", True)


async def test_the_log_contains_no_token(tmp_path):
    async with Running(config_of(tmp_path)) as running:
        wire = await Raw.open(running.port)
        wire.send(m.Hello(versions=(1,), name="a", token="hush-hush"))
        await wire.get(m.Welcome)
        bad = await Raw.open(running.port)
        payload = msgpack.packb({"type": "hello", "versions": [1], "name": "a", "token": ["hush"]})
        bad.send_bytes(frame(payload))
        await bad.rest()
    assert "hush" not in running.log.getvalue()
    assert running.logged("welcome")


async def test_a_port_in_use_is_an_error_of_the_system(tmp_path):
    async with Running(config_of(tmp_path)) as running:
        taken = Running(config_of(tmp_path, server={"port": running.port}))
        with pytest.raises(OSError, match="in use"):
            await taken.daemon.run(lambda host, port: None)
        taken.writer.close()


async def test_a_client_that_never_reads_delays_no_other_client(tmp_path):
    async with Running(config_of(tmp_path)) as running:
        deaf = await Raw.hello(running.port, "deaf", "observer")
        deaf.send(m.Subscribe())
        deaf.writer.transport.pause_reading()
        mover = await Mover.start(running.port, "A")
        await mover.moves_on(50)
        await mover.stop()


@pytest.mark.slow
async def test_a_signal_stops_the_robots_even_if_listening_cannot_be_stopped(tmp_path, monkeypatch):
    async with Running(config_of(tmp_path)) as running:
        eye = await Raw.hello(running.port, "eye", "observer")
        sessions, told = running.daemon._sessions, []
        close = sessions.stop_listening

        def broken():
            close()
            told.append(running.daemon._life.phase)
            raise PermissionError(13, "no")

        monkeypatch.setattr(sessions, "stop_listening", broken)
        with pytest.raises(PermissionError):
            running.daemon.end()
        assert [x.by for x in await eye.rest() if isinstance(x, m.Stopped)] == ["daemon"]
        assert await running.status() == 0
        assert told == [Phase.RESTING]


FEW = {"login_failures": 3, "login_failures_per_address": 3}


async def test_connections_that_are_never_welcomed_leave_a_bounded_log(tmp_path):
    async with Running(config_of(tmp_path, server=FEW), keys=Keys(tokens=Tokens([]))) as running:
        for _ in range(10):
            guess, crooked, silent = [await Raw.open(running.port) for _ in range(3)]
            guess.send(m.Hello(versions=(1,), name="guess", token="guess"))
            crooked.send_bytes(b"\x00" * 4)
            await silent.close()
            assert (await guess.rest())[-1].code == "unauthorized"
            await crooked.rest()
    assert len(running.logged("login.failed")) == 3
    assert not running.logged("gone")
    assert not running.logged("refused")


async def test_other_refusals_are_logged_up_to_a_bound(tmp_path, monkeypatch):
    async with Running(config_of(tmp_path, server=FEW)) as running:
        monkeypatch.setattr(ConnectionLimits, "admit", lambda *_: "there is no room")
        for _ in range(10):
            wire = await Raw.open(running.port)
            wire.send(m.Hello(versions=(1,), name="stranger"))
            await wire.rest()
    assert [line["name"] for line in running.logged("refused")] == ["stranger"] * 3
