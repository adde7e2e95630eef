"""Programs in a world: their ends, their failures, and copies of them."""

import pickle
from collections.abc import Callable
from functools import partial
from typing import Any

import pytest

from armgate.apps.default_files import default_file
from armgate.apps.follow.program import make as follow
from armgate.apps.lead.pursuit import make as pursue
from armgate.cell.cell import Cell, build_cell
from armgate.cell.config import in_lockstep, load_config
from armgate.client import BadArgument, Tick, Verdict
from armgate.client.program import REST, Increments, Outcome, ProgramContext, TickProgram
from armgate.programs import Controller, WorldRun, run
from armgate.protocol import messages as m
from armgate.world import World


@pytest.fixture(scope="module")
def planar() -> Cell:
    return build_cell(in_lockstep(load_config([default_file("planar.yaml")]), ["one", "two"]))


@pytest.fixture(scope="module")
def demo() -> Cell:
    return build_cell(in_lockstep(load_config([default_file("demo.yaml")]), ["leader", "follower"]))


class Turn(TickProgram):
    """Turn the first joint for some ticks; ``what`` may change the increments of a tick."""

    def __init__(self, ticks: int = 10, what: Callable[[int], Any] = lambda tick: (0.001, 0.0, 0.0)) -> None:
        self.ticks, self.what = ticks, what
        self.verdicts: list[Verdict] = []
        self.seen: list[int] = []
        self.values: dict[str, Any] = {}

    def step(self, tick: Tick) -> Increments | None:
        self.seen.append(tick.tick)
        return None if tick.tick >= self.ticks else self.what(tick.tick)

    def verdict(self, verdict: Verdict) -> None:
        self.verdicts.append(verdict)

    def signals(self) -> dict[str, Any]:
        return self.values


def ran(
    cell: Cell, program: TickProgram, event: Callable[[World, int], None] = lambda world, step: None
) -> tuple[Outcome | None, World, list[str]]:
    """Run a program as participant ``one``; ``event`` is called after each of at most 50 steps."""
    world, lines = World(cell), list[str]()
    running = WorldRun(
        world, {"one": Controller(lambda _: program, "P")}, report=lambda _name, text: lines.append(text)
    )
    for step in range(50):
        if not running.step():
            break
        event(world, step)
    return running.outcomes["one"], world, lines


def test_a_program_acts_once_per_tick_and_takes_each_verdict(planar: Cell) -> None:
    program = Turn(10)
    outcome, world, _ = ran(planar, program)
    assert outcome == Outcome("ended")
    assert program.seen == list(range(11))
    assert [verdict.outcome for verdict in program.verdicts] == ["admitted"] * 10
    assert world.clients == ()  # it has released its robot and left


def test_a_tick_without_a_command_lets_the_robot_brake(planar: Cell) -> None:
    program = Turn(10, lambda tick: (0.001, 0.0, 0.0) if tick < 5 else REST)
    outcome, _, _ = ran(planar, program)
    assert outcome == Outcome("ended")
    assert len(program.verdicts) == 5


def test_a_stop_ends_a_program_as_failed_with_its_reason(planar: Cell) -> None:
    def stop(world: World, step: int) -> None:
        if step == 3:
            world.join("eye", "observer").send(m.Stop(reason="too close"))

    outcome, _, _ = ran(planar, Turn(40), stop)
    assert outcome is not None
    assert outcome.failed
    assert "P was stopped by eye (too close)" in outcome.text


def test_a_program_that_is_kicked_before_it_acts_ends_as_failed(planar: Cell) -> None:
    def kick(world: World, step: int) -> None:
        if step == 3:
            world.join("eye", "operator").request(m.Kick(session="p0", reason="too fast"))

    outcome, _, _ = ran(planar, Turn(40), kick)
    assert outcome is not None
    assert outcome.failed
    assert "eye ended this session: too fast" in outcome.text


def test_a_run_whose_program_is_kicked_at_its_end_ends_all_sessions(planar: Cell) -> None:
    world = World(planar)
    operator = world.join("eye", "operator")
    controllers = {"one": Controller(lambda _: Turn(40), "P"), "two": Controller(lambda _: Turn(40))}
    running = WorldRun(world, controllers)
    operator.request(m.Kick(session="p0"))
    running.close()
    assert world.clients == (operator,)


def test_a_program_that_is_kicked_between_its_command_and_the_verdict_ends_as_failed(planar: Cell) -> None:
    world = World(planar)
    operator = world.join("eye", "operator")
    one = WorldRun(world, {"one": Controller(lambda _: Turn(40), "P")}).participants["one"]
    one.act()
    operator.request(m.Kick(session="p0", reason="too fast"))
    world.step()
    one.take()
    assert one.outcome is not None
    assert one.outcome.failed
    assert "eye ended this session: too fast" in one.outcome.text


@pytest.mark.parametrize("dq", [("a", 0.0, 0.0), (None, 0.0, 0.0)])
def test_invalid_increments_end_a_program_with_one_error(planar: Cell, dq: Any) -> None:
    outcome, _, _ = ran(planar, Turn(40, lambda tick: dq))
    assert outcome is not None
    assert outcome.failed
    assert outcome.text == "command: dq.0: Input should be a valid number"


@pytest.mark.parametrize("dq", [(0.001,), (float("nan"), 0.0, 0.0)])
def test_increments_that_no_robot_can_play_are_refused_by_the_gate(planar: Cell, dq: Any) -> None:
    program = Turn(3, lambda tick: dq)
    ran(planar, program)
    assert [verdict.outcome for verdict in program.verdicts] == ["refused"] * 3


def test_refused_signals_are_reported_once_and_end_no_program(planar: Cell) -> None:
    program = Turn(6)
    program.values = {"operator.distance": 1.0, "one.value": 2.0}
    outcome, _, lines = ran(planar, program)
    assert outcome == Outcome("ended")
    (line,) = lines
    assert line.startswith("some signals are not shared: signal was refused: forbidden")


def test_a_robot_that_is_held_cannot_be_acquired_by_a_second_program(planar: Cell) -> None:
    controllers = {name: Controller(lambda _: Turn(), "P") for name in ("one", "two")}
    with pytest.raises(Exception, match="leased"):
        WorldRun(World(planar), controllers)


def test_an_interrupted_program_is_asked_and_then_ended(planar: Cell) -> None:
    world = World(planar)
    running = WorldRun(world, {"one": Controller(lambda _: Turn(40), "P")})
    for _ in range(5):
        running.step()
    running.participants["one"].interrupt()
    assert not running.step()
    assert running.outcomes == {"one": Outcome("interrupted")}


def test_a_run_ends_after_its_time_and_all_sessions_end(planar: Cell) -> None:
    world = World(planar)
    outcomes = run(world, {"one": Controller(lambda _: Turn(10_000), "P")}, seconds=0.5)
    assert outcomes == {"one": None}
    assert world.time == pytest.approx(0.5, abs=0.02)
    world.step()
    assert world.clients == ()


def test_a_program_that_commands_a_robot_needs_its_name(demo: Cell) -> None:
    with pytest.raises(BadArgument, match="expected one of FR, GR"):
        run(World(demo), {"follower": Controller(partial(follow, leader="GR"))})


def test_copies_of_participants_continue_in_copies_of_their_world(demo: Cell) -> None:
    def states(world: World, participants: list[Any]) -> list[Any]:
        found = []
        for _ in range(40):
            for participant in participants:
                participant.act()
            world.step()
            for participant in participants:
                participant.take()
            found.append(participants[1]._session.state)
        return found

    controllers = {
        "leader": Controller(partial(pursue, target="FR/link_3"), "GR"),
        "follower": Controller(partial(follow, leader="GR"), "FR"),
    }
    world = World(demo)
    running = WorldRun(world, controllers)
    for _ in range(60):
        running.step()
    saved, copied = world.save(), pickle.dumps(list(running.participants.values()))
    expected = states(world, list(running.participants.values()))
    again = World.restored(demo, saved)
    copies = pickle.loads(copied)
    for copy in copies:
        copy.rejoin(again)
    assert states(again, copies) == expected


def test_the_context_names_the_robot_and_the_seed(planar: Cell) -> None:
    found: list[ProgramContext] = []

    def make(context: ProgramContext) -> TickProgram:
        found.append(context)
        return Turn()

    WorldRun(World(planar), {"one": Controller(make, "P", seed=7)})
    (context,) = found
    assert (context.own, context.seed) == ("P", 7)
    assert context.cell.description.name == "planar"
    assert context.cell.urdf("P") == planar.robots[0].urdf


def test_an_error_of_a_program_ends_all_sessions(planar: Cell) -> None:
    world, broken = World(planar), Turn(what=lambda tick: 1 // 0)
    with pytest.raises(ZeroDivisionError):
        run(world, {"one": Controller(lambda _: broken, "P"), "two": Controller(lambda _: Turn())})
    assert all(client.ended for client in world.clients)


def test_a_run_that_waits_for_an_unknown_participant_is_one_error(planar: Cell) -> None:
    with pytest.raises(ValueError, match="until: no participant x; expected one"):
        run(World(planar), {"one": Controller(lambda _: Turn(), "P")}, until=["x"])
