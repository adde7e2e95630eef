"""The display, read as text from a recording console."""

import io
from collections.abc import Callable
from pathlib import Path

import pytest
from rich.console import Console

from armgate.apps.demo.display import line, picture, screen, tally
from armgate.apps.demo.summary import summary
from armgate.apps.stack.metrics import compute
from armgate.apps.stack.observation import Observation
from armgate.apps.stack.run import Watch
from armgate.client import Description, State

Make = Callable[..., State]


def text_of(renderable: object, width: int = 120) -> str:
    console = Console(width=width, file=io.StringIO(), record=True, color_system=None)
    console.print(renderable)
    return console.export_text()


def observation_of(*states: State) -> Observation:
    seen = Observation("FR")
    for state in states:
        seen.take(state)
    return seen


def test_the_picture_shows_robots_camera_path_and_warnings(
    description: Description, make_state: Make
) -> None:
    counts = {"admitted": 41, "limited:acceleration": 5, "refused:clearance": 2}
    near = (("FR/link_1", "FR/link_3", 0.01, 0.02),)
    more = {"counts": counts, "warnings": ("engine gap",), "near": near}
    state = make_state(48, angle=0.31, distance=-0.0042, progress=0.42, **more)
    shown = text_of(picture(observation_of(make_state(0), state), description, 1.0))
    for expected in (
        "demo", "0.6 s by the wall clock", "1.0 × real time", "FR", "GR", "48", "follower",
        "28.6  -57.3°", "2.930 m", "FR refused: too near",
        "41", "5", "2", "400 mm", "FR/link_5 – GR/link_6", "+0.31°", "± 1°", "-4.2 mm", "± 20 mm", "300 mm",
        "42 %", "! engine gap",
    ):  # fmt: skip
        assert expected in shown, f"{expected!r} is not in\n{shown}"


def test_the_picture_before_anything_is_known(description: Description, make_state: Make) -> None:
    assert "view angle" in text_of(picture(Observation("FR"), description, None))
    shown = text_of(picture(observation_of(make_state(0, angle=None)), description, None))
    assert "0 %" in shown


@pytest.mark.parametrize(("angle", "mark"), [(-9.0, "●─"), (0.0, "─●─"), (9.0, "─●")])
def test_a_gauge_stays_on_its_scale(
    description: Description, make_state: Make, angle: float, mark: str
) -> None:
    shown = text_of(picture(observation_of(make_state(0, angle=angle)), description, None))
    row = next(row for row in shown.splitlines() if "view angle" in row)
    assert mark in row
    assert row.count("●") == 1


def test_the_picture_fits_eighty_columns(description: Description, make_state: Make) -> None:
    shown = text_of(picture(observation_of(make_state(0)), description, None), width=80)
    assert max(map(len, shown.splitlines())) <= 80
    assert "FR/link_5" in shown


def test_the_line_of_text(make_state: Make) -> None:
    counts = {"admitted": 41, "refused:stale": 2}
    shown = line(
        observation_of(
            make_state(0), make_state(100, angle=0.5, distance=0.001, progress=0.25, counts=counts)
        )
    )
    expected = "1.2 s path 25 % angle 0.50° distance +1.0 mm clearance 300 mm FR 41/0/2 GR 41/0/2"
    assert " ".join(shown.split()) == expected
    assert "path   –" in line(Observation("FR"))
    assert tally(make_state(1).entries[0]) == (1, 0, 0)


def watched(description: Description, seen: Observation) -> Watch:
    return Watch(seen, description)


def test_without_a_terminal_one_line_is_printed_per_second(
    description: Description, make_state: Make
) -> None:
    out = io.StringIO()
    seen = Observation("FR")
    with screen(False, Console(file=out, width=40)) as show:
        show(watched(description, seen))
        for tick in range(300):
            seen.take(make_state(tick))
            show(watched(description, seen))
    lines = out.getvalue().splitlines()
    assert [row.split()[0] for row in lines] == ["0.0", "1.0", "2.0", "3.0"]


def test_in_a_terminal_the_picture_is_drawn_at_once(description: Description, make_state: Make) -> None:
    out = io.StringIO()
    console = Console(file=out, width=120, force_terminal=True, _environ={"TERM": "xterm"})
    with screen(True, console) as show:
        show(watched(description, observation_of(make_state(3))))
        assert "view angle" in out.getvalue()


def test_the_summary_shows_which_claims_hold(make_state: Make) -> None:
    states = [make_state(k, angle=0.1, distance=0.001) for k in range(200)]
    good = compute(observation_of(*states), 0.05, 2.0, True)
    shown = text_of(summary(good, Path("runs/x"), []))
    assert shown.count("holds") == 4
    assert "does not hold" not in shown
    assert "max 0.10°" in shown
    assert "smallest 300 mm, FR/link_5 – GR/link_6" in shown
    bad = compute(observation_of(*states, make_state(200, angle=2.0)), 0.05, 2.0, False)
    shown = text_of(summary(bad, Path("runs/x"), []))
    assert shown.count("does not hold") == 1
    assert "ended early" in shown
    short = compute(observation_of(make_state(0)), 0.05, 0.0, False)
    assert text_of(summary(short, Path("runs/x"), [])).count("too short to decide") == 2


def test_the_summary_names_reasons_and_missed_states(make_state: Make) -> None:
    counts = {"admitted": 4, "limited:acceleration": 3, "refused:stale": 2, "refused:clearance": 1}
    seen = observation_of(make_state(1), make_state(5, counts=counts))
    shown = text_of(summary(compute(seen, 0.05, 1.0, True), Path("runs/x"), []))
    assert "4 commands admitted, 3 limited (acceleration 3), 3 refused (clearance 1, stale 2)" in shown
    assert "3 states of FR" in shown
