"""``armgate explain``: limited and refused commands, in text and pictures."""

import numpy as np
import pytest

from armgate.audit.explain import at_tick, explanation, first_refusals, selected_commands
from armgate.audit.explain_picture import draw_explanation, outline, view_along
from armgate.audit.recorded_cell import recorded_cell
from armgate.cell.cell import build_cell
from armgate.cell.config import load_config
from armgate.events import Cause, Outcome
from armgate.recording import Recording
from support.cells import arms_yaml
from support.clients import run
from support.gate_runs import record_run

PNG = b"\x89PNG\r\n\x1a\n"


def commands(k):
    """Return the commands of step k: A turns into the post, B exceeds its speed once."""
    return {"A": (-0.004, 0.0, 0.0), "B": (0.0, 9.0 if k == 40 else 0.0, 0.0)} if k > 2 else {}


@pytest.fixture(scope="module")
def clash(tmp_path_factory):
    folder = tmp_path_factory.mktemp("clash")
    file = folder / "arms.yaml"
    file.write_text(arms_yaml().replace("[0.6, 0.9, 0.5]", "[0.9, 0.0, 0.5]"))
    record_run(build_cell(load_config([file])), folder / "run", 330, commands).close()
    return folder / "run"


@pytest.fixture(scope="module")
def opened(clash):
    recording = Recording.open(clash)
    return recording, recorded_cell(recording.header)


def test_a_refusal_by_clearance_is_explained_with_pair_points_and_distance(opened, tmp_path):
    recording, cell = opened
    found = next(selected_commands(recording, cell, first_refusals(None)))
    assert found.reason.cause is Cause.CLEARANCE
    assert "post" in found.reason.pair
    # The nearest points are on the bodies, closer than the required distance, at the end of that stop.
    distance = np.linalg.norm(np.subtract(*found.points))
    assert distance < cell.config.stop_distance
    assert distance >= found.reason.value - 1e-6
    text = explanation(found, cell)
    for part in (f"A, tick {found.tick}", "refused", "post", f"{1000 * distance:.1f} mm apart", "short by"):
        assert part in text
    assert draw_explanation(found, cell, tmp_path / "a.png")
    assert (tmp_path / "a.png").read_bytes().startswith(PNG)


def test_consecutive_refusals_with_the_same_reason_are_explained_once(opened):
    recording, cell = opened
    refused = [
        output
        for _, step in recording.steps()
        for output in step.outputs
        if getattr(output, "outcome", None) is Outcome.REFUSED
    ]
    explained = list(selected_commands(recording, cell, first_refusals(None)))
    assert 0 < len(explained) < len(refused)


def test_a_limited_joint_is_explained_with_its_bound(opened, tmp_path):
    recording, cell = opened
    (found,) = selected_commands(recording, cell, at_tick(41, "B"))
    text = explanation(found, cell)
    for part in ("B, tick 41", "limited", "J2: the speed bound allows", "J2: the acceleration bound allows"):
        assert part in text
    assert draw_explanation(found, cell, tmp_path / "b.png")
    assert (tmp_path / "b.png").stat().st_size > 10_000


def test_an_outline_encloses_its_body(opened):
    _, cell = opened
    post = next(body for body in cell.bodies if body.name == "post")
    place = (np.asarray(post.placement.R), np.asarray(post.placement.t))
    corners = outline(post, place, view_along(np.zeros(3), np.array([1.0, 0.0, 0.3])))
    assert np.allclose(corners.max(axis=0), [0.95, 1.0], atol=1e-3)
    assert np.allclose(corners.min(axis=0), [0.85, 0.0], atol=1e-3)


@pytest.mark.slow
async def test_the_command_writes_pictures_beside_the_recording(clash, tmp_path):
    status, out, err = await run("explain", clash, "--tick", 41, "--robot", "B", "--out", tmp_path)
    assert (status, err) == (0, "")
    (picture,) = tmp_path.glob("explain-B-41-*.png")
    assert str(picture) in out


@pytest.mark.daily(1)
@pytest.mark.parametrize(
    ("options", "status", "text"),
    [
        ((), 2, "--tick N and --refused"),
        (("--tick", 3, "--refused"), 2, "--tick N and --refused"),
        (("--tick", 3, "--robot", "C"), 2, "the recording has A, B"),
        (("--tick", 99999), 1, "there is no command for tick 99999"),
        (("--refused", "--robot", "B"), 1, "no command of B was refused"),
    ],
)
async def test_a_command_that_cannot_be_explained_is_an_error(clash, options, status, text):
    code, _, err = await run("explain", clash, *options)
    assert code == status
    assert text in err
