"""Programs over a connection: interruption, ticks without a command, and programs without a robot."""

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

from armgate.client import Tick
from armgate.client.program import INTERRUPTED, REST, Increments, Outcome, TickProgram, run, run_held
from armgate.client.shared_signals import SharedSignals


class Held:
    """Robot that is held; it records what is sent."""

    def __init__(self) -> None:
        self.calls: list[Any] = []

    def ticks(self) -> Iterator[Any]:
        yield from (SimpleNamespace(tick=k) for k in range(100))

    def send(self, dq: Any) -> Any:
        self.calls.append(dq)
        return SimpleNamespace(outcome="admitted")

    def skip(self) -> None:
        self.calls.append("skip")


class Counting(TickProgram):
    """Program that ends at tick 6 and rests at odd ticks."""

    def __init__(self) -> None:
        self.verdicts = 0

    def step(self, tick: Tick) -> Increments | None:
        return None if tick.tick == 6 else REST if tick.tick % 2 else (0.1,)

    def verdict(self, verdict: Any) -> None:
        self.verdicts += 1


class Stubborn(Counting):
    """Program that ends by itself after an interruption."""

    def interrupt(self) -> bool:
        return True


NO_SIGNALS = SharedSignals(SimpleNamespace(), lambda _line: None)  # type: ignore[arg-type]


def driven(program: TickProgram, interrupt: Any = None) -> tuple[Outcome, list[Any]]:
    robot = Held()
    return run_held(robot, program, NO_SIGNALS, interrupt), robot.calls  # type: ignore[arg-type]


def test_each_tick_has_a_command_or_is_skipped() -> None:
    program = Counting()
    assert driven(program) == (Outcome("ended"), [(0.1,), "skip"] * 3)
    assert program.verdicts == 3


def test_an_interruption_ends_a_program_at_once_unless_it_ends_by_itself() -> None:
    request = SimpleNamespace(requested=True)
    assert driven(Counting(), request) == (INTERRUPTED, [])
    assert driven(Stubborn(), request) == (Outcome("ended"), [(0.1,), "skip"] * 3)


def test_a_program_without_a_robot_acts_once_per_step_and_always_by_the_wall_clock() -> None:
    def passes(steps: list[int | None]) -> int:
        calls: list[Any] = []
        states = [SimpleNamespace(robot="P", tick=0, step=step) for step in steps]
        states.append(SimpleNamespace(robot="P", tick=6, step=99))
        cell: Any = SimpleNamespace(
            subscribe=lambda **_: None, states=lambda: iter(states), skip=lambda: calls.append("skip")
        )
        assert run(cell, None, Counting()) == Outcome("ended")
        return len(calls)

    assert passes([0, 0, 1, 1, 1, 2]) == 3
    assert passes([None, None, None]) == 3
